"""A size in the words in which people think: the rate of a limit, and not its inverse."""

import pytest

from tests.gap.report.test_system_page import result
from wakedeploy.gap.report.system_page import write_page
from wakedeploy.gap.search.artefacts import Size
from wakedeploy.gap.systems.answers.reader_units import as_read, inverse_unit, sizes_as_read
from wakedeploy.gap.systems.answers.words import sentences

LIMIT = "rate-limit@steer_rad"
SLOWNESS = {"value": 0.8, "low": 0.64, "high": 1.0, "unit": "s/rad"}


def size(**changed: float | str) -> Size:
    return Size.model_validate(SLOWNESS | changed)


def test_a_limit_to_a_rate_is_told_as_the_rate_with_its_interval() -> None:
    name, rate = as_read(LIMIT, "slowness", size())
    assert (name, rate.unit) == ("rate", "rad/s")
    assert (rate.value, rate.low, rate.high) == pytest.approx((1.25, 1.0, 1.5625))


@pytest.mark.parametrize("changed", [{"low": 0.0}, {"low": -0.1}, {"value": 0.0, "low": 0.0}])
def test_one_that_may_be_no_limit_has_no_largest_rate_and_stays_as_it_is(changed) -> None:
    assert as_read(LIMIT, "slowness", size(**changed)) == ("slowness", size(**changed))


def test_other_parameters_and_effects_of_a_users_own_stay() -> None:
    for name, parameter in (("lag@steer_rad", "tau_s"), ("my-own", "slowness"), (LIMIT, "other")):
        assert as_read(name, parameter, size()) == (parameter, size())


@pytest.mark.parametrize(
    ("unit", "turned"),
    [("s/rad", "rad/s"), ("s/(N m)", "N m/s"), ("s", "1/s"), ("s/(m/s)", "m/s/s"), ("s/%", "%/s")],
)
def test_the_unit_is_turned_too(unit: str, turned: str) -> None:
    assert inverse_unit(unit) == turned


def test_what_is_seen_of_a_limit_is_the_fastest_that_is_seen() -> None:
    assert sizes_as_read(LIMIT, "slowness", "s/rad", [0.5, 4.0]) == ("rate", "rad/s", [2.0, 0.25])
    assert sizes_as_read("lag@steer_rad", "tau_s", "s", [0.5]) == ("tau_s", "s", [0.5])
    assert sizes_as_read(LIMIT, "slowness", "s/rad", [float("inf"), 0.0])[2] == [0.0, float("inf")]


@pytest.mark.whole
def test_screen_and_page_tell_the_rate(tmp_path) -> None:
    effects = [{"name": LIMIT, "parameters": {"slowness": SLOWNESS},
                "forecast": {"share": 0.4, "low": 0.3, "high": 0.5}}]  # fmt: skip
    answer = result(effects=effects)
    assert any(f"{LIMIT}: rate 1.25 rad/s (1.00 to 1.56); " in line for line in sentences(answer))
    write_page(answer, tmp_path)
    page = (tmp_path / "report.html").read_text("utf-8")
    assert "1.25 rad/s (1.00 to 1.56)" in page
    assert "slowness" not in page
