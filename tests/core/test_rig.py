"""The rig file: every bound is told by name, and what is written is what is read."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig_sections import Limits
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import default_rig, default_rig_text, parse_rig, read_rig


def test_the_default_lead_is_near_the_delay_of_a_command() -> None:
    assert default_lead_s(default_rig()) == pytest.approx(0.09, abs=0.01)


def test_a_rig_without_spool_has_motors_that_follow_at_once() -> None:
    rig = default_rig().without("spool")
    assert rig.spool.sufferer.up_s == 0.0
    assert default_lead_s(rig) == rig.latency.round_trip_s


@given(
    mass=st.floats(0.05, 0.8),
    speed=st.floats(0.5, 50.0),
    spread=st.floats(0.0, 1.0),
    up=st.floats(0.0, 1.0),
)
def test_what_is_written_is_read_back(mass: float, speed: float, spread: float, up: float) -> None:
    rig = default_rig().changed(
        sufferer={"mass_kg": mass},
        wake={"speed_mps": {"value": speed, "spread": spread, "unit": "m/s"}},
        spool={"sufferer": {"up_s": up}},
    )
    again = parse_rig(rig.text)
    assert again == rig
    assert again.sha256 == rig.sha256
    assert again.calibration["wake.speed_mps"].spread == spread


def test_comments_do_not_change_the_hash() -> None:
    bare = "\n".join(line.split("#")[0] for line in default_rig_text().splitlines())
    assert parse_rig(bare).sha256 == default_rig().sha256


def test_a_mark_of_the_byte_order_is_no_part_of_a_rig_file(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(default_rig_text(), encoding="utf-8-sig")
    assert read_rig(path) == default_rig()


@given(st.floats(1000.0, 2000.0))
def test_the_thrust_curve_and_its_inverse_undo_each_other(pulse_us: float) -> None:
    curve = default_rig().thrust.sufferer
    assert curve.pulse(curve.thrust(pulse_us)) == pytest.approx(pulse_us, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"wake": {"speed_mps": -1.0}}, ("wake.speed_mps", "-1.0", "0.1")),
        ({"sufferer": {"mas_kg": 0.4}}, ("mas_kg", "not known")),
        ({"sufferer": {"mass_kg": "heavy"}}, ("mass_kg", "heavy")),
        ({"sufferer": {"mass_kg": {"value": 0.4, "unit": "N"}}}, ("mass_kg", "kg", "'N'")),
        ({"sufferer": {"mass_kg": {"value": 0.4, "spread": -1.0}}}, ("spread", "-1.0")),
        ({"sufferer": {"travel_m": 3.0}}, ("travel_m", "height_m")),
        ({"sufferer": {"mass_kg": 2.0}}, ("thrust.sufferer", "19.62 N")),
        ({"limits": {"x_m": [0.5, -0.5]}}, ("x_m", "lower")),
        ({"thrust": {"source": {"thrust_n": [0.0, 1.0]}}}, ("same number",)),
        ({"wake": {"speed_mps": float("nan")}}, ("speed_mps",)),
        ({"limits": {"pulse_us": [100.0, 2000.0]}}, ("pulse_us", "100.0", "500")),
        ({"limits": {"pulse_us": [1000.0, 40_000.0]}}, ("pulse_us", "40000.0", "2500")),
        ({"limits": {"pulse_us": [1000.1, 1000.2]}}, ("pulse_us", "1 us")),
        ({"limits": {"source_descent_s": 0.0004}}, ("source_descent_s", "0.0004", "0.01")),
        ({"limits": {"sufferer_descent_s": 0.009}}, ("sufferer_descent_s", "0.01")),
        ({"limits": {"slew_us_per_s": 0.4}}, ("slew_us_per_s", "0.4", "1")),
        ({"limits": {"x_m": [-1e6, 0.6]}}, ("x_m", "-1000000.0", "-20")),
        ({"limits": {"z_m": [-0.05, 21.0]}}, ("z_m", "21.0", "20")),
        ({"stepper": {"steps_per_m": 70_000}}, ("max_speed_mps", "steps_per_m", "10000", "35000")),
        ({"stepper": {"max_speed_mps": 1e-5}}, ("max_speed_mps", "steps_per_m", "0.042")),
        ({"stepper": {"max_accel_mps2": 1e-5}}, ("max_accel_mps2", "steps_per_m")),
    ],
)
def test_what_is_wrong_is_named(change: dict[str, dict[str, object]], words: list[str]) -> None:
    with pytest.raises(UnusableInput) as caught:
        default_rig().changed(**change)
    assert all(word in str(caught.value) for word in words)
    assert "\n" not in str(caught.value)


def test_a_newer_schema_says_so(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text(default_rig_text().replace("schema = 1", "schema = 7"))
    with pytest.raises(UnusableInput, match=r"rig\.toml: schema 7 is newer"):
        read_rig(path)


@given(st.binary(max_size=200))
def test_any_file_is_read_or_refused_in_one_sentence(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    path.write_bytes(content)
    with pytest.raises(UnusableInput):
        read_rig(path)


def test_a_constant_that_rig_files_once_did_not_have_changes_no_hash_at_its_default() -> None:
    rig = default_rig()
    assert "brake_s" not in rig.text
    other = rig.changed(limits={"sink_s": 3.0})
    assert other.sha256 != rig.sha256
    assert parse_rig(other.text).limits.sink_s == 3.0


def test_the_page_of_the_rig_file_has_the_times_of_a_descent() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "rig-file.md").read_text("utf-8")
    names = ("source_descent_s", "brake_s", "sink_s", "sink_rate_us_per_s", "sufferer_descent_s")
    for name in names:
        field = Limits.model_fields[name]
        low, high = (
            getattr(bound, key) for bound, key in zip(field.metadata, ("ge", "le"), strict=True)
        )
        assert f"| `{name}` | {field.default} | {low:g} to {high:g} |" in page
