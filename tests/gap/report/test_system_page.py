"""The page of a user's system: what it says beside a table or a figure is what these show."""

import html
import re
from pathlib import Path

import pytest

from wakedeploy.gap.report.system_page import write_page
from wakedeploy.gap.search.artefacts import Result
from wakedeploy.gap.systems.answers.words import first_screen, next_step, remarks
from wakedeploy.gap.systems.kinds.library import KINDS_BY_ROLE, plain

FRICTION = "coulomb-friction@speed_mps"
FORCE = {"value": 1.26, "low": 1.01, "high": 1.51, "unit": "N"}
EDGES = [0.0, 1.0, 2.0]


def white(passes: bool, after_one: float = 0.0) -> dict[str, object]:
    statistic = 16.6 if passes else 40.0
    return {
        "p_value": 0.1, "statistic": statistic, "limit": 39.0, "passes": passes,
        "lags": [1, 2], "autocorrelation": [after_one, -0.04], "samples": 900,
    }  # fmt: skip


def profile(coordinate: str, before: float) -> dict[str, object]:
    return {
        "channel": "cart_m", "unit": "m", "coordinate": coordinate, "coordinate_unit": "1",
        "edges": EDGES, "before": [before, -0.01], "after": [0.001, 0.001],
    }  # fmt: skip


def mapped(q_value: float) -> dict[str, object]:
    return {
        "channel": "cart_m", "coordinate": "time", "exogenous": True, "unit": "m",
        "coordinate_unit": "s", "edges": EDGES, "mean": [0.03, -0.01], "low": [0.0, -0.03],
        "high": [0.06, 0.01], "count": [9, 9], "p_value": q_value, "clarity": 1.0, "strength": 1.0,
        "q_value": q_value,
    }  # fmt: skip


def place(q_value: float) -> dict[str, object]:
    return {
        "channel": "cart_m", "coordinate": "time", "exogenous": True, "low": 0.0, "high": 1.0,
        "residual": -0.03, "unit": "m", "coordinate_unit": "s", "q_value": q_value, "clarity": 3.0,
        "words": "time below 1 s: −30.0 mm (cart_m), q = 0.010",
    }  # fmt: skip


def result(**changed: object) -> Result:
    """A named friction, as a step leaves it."""
    share = {"share": 0.998, "low": 0.996, "high": 0.999}
    course = {"unit": "m", "measured": [0.0, 0.1, -0.2], "before": [0.0, 0.1, 0.0],
              "after": [0.0, 0.1, -0.19]}  # fmt: skip
    ranked = {"name": FRICTION, "gain_nats": 90.0, "needed_nats": 6.0, "interval": [80.0, 100.0],
              "parameters": {f"{FRICTION}.force": FORCE}}  # fmt: skip
    told: dict[str, object] = {
        "domain": "MyRobot", "key": "", "verdict": "named", "class": [], "threshold_nats": 6.0,
        "episodes": ["a 1/2", "a 2/2"], "sealed": ["a 2/2"], "where": [], "maps": [mapped(0.3)],
        "effects": [{"name": FRICTION, "parameters": {"force": FORCE}, "forecast": share}],
        "parameters": {}, "constants": {}, "noise": {}, "unsettled": [], "sealed_gain_nats": 449.8,
        "rounds": [{"given": [], "threshold_nats": 6.0, "steady_nats": 6.0, "ranking": [ranked]}],
        "placebo": {"name": "offset@speed_mps", "before": [0.047], "after": [0.048],
                    "sealed_gain_nats": -1.4},
        "gap": {"cart_m": {"before": 0.047, "after": 0.0015, "unit": "m"}}, "removed": share,
        "white": {"before": white(True), "after": white(False)}, "forecast_s": 0.9,
        "shown": {
            "places": [profile(f"c{i}", 0.031) for i in range(4)],
            "trace": {"episode": "a 2/2", "time_s": [0.0, 0.1, 0.2],
                      "channels": {"cart_m": course}},
        },
    }  # fmt: skip
    return Result.model_validate(told | changed)


def read(told: Result, folder: Path) -> tuple[str, str]:
    """The page, and its words."""
    page = write_page(
        told, folder, answers=first_screen(told), remarks=remarks(told),
        next_step=(next_step(told), ["wakedeploy gap simulate --correction gap/correction.toml"]),
    ).read_text("utf-8")  # fmt: skip
    words = re.sub(r"<(style|script).*?</\1>|<[^>]+>", " ", page, flags=re.DOTALL)
    return page, " ".join(html.unescape(words).split())


@pytest.fixture(scope="module")
def friction(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    return read(result(), tmp_path_factory.mktemp("named"))


def test_the_first_screen_says_what_the_effect_is_and_has_numbers_and_a_command(friction) -> None:
    page, words = friction
    screen, _, below = words.partition(" In detail effect ")
    assert "The system lacks dry friction that acts on speed_mps ( coulomb-friction" in screen
    assert "1.26 N (1.01 to 1.51) force" in screen
    assert "47 mm error of cart_m, before 1.50 mm error of cart_m, after" in screen
    assert "Next step: replay a log" in screen
    assert below
    for anchor in re.findall(r'href="#(\w+)"', page):
        assert page.count(f'id="{anchor}"') == 1


@pytest.mark.whole
def test_what_is_left_is_said_on_the_first_screen_where_forecasts_could_gain_by_it(
    friction, tmp_path
) -> None:
    left = "What is left of cart_m is more than noise: its past foretells 20 % of it"
    assert "the innovations are more than noise (statistic 40, of noise alone" in friction[1]
    assert "past foretells" not in friction[1]
    for passes in (True, False):
        quiet = {"before": white(True), "after": white(passes, 0.5)}
        words = read(result(white=quiet), tmp_path)[1]
        assert (left in words.partition(" In detail effect ")[0]) is not passes


@pytest.mark.parametrize(("share", "is_said"), [(6.6, True), (0.2, False)])
def test_a_push_of_most_of_what_acts_is_said_beside_a_name(share: float, is_said: bool) -> None:
    push = {"state": "speed_mps", "sd": 1.0, "unit": "m/s²", "lasts_s": 0.1, "matters": True}
    push |= {"share": share, "of_parts": share}
    said = first_screen(result(unexplained=[push]))[2]
    assert said.startswith("How sure is that?")
    something = "Something else acts, too: a push on speed_mps of 660 % of its usual rate is left"
    assert (something in said) is is_said


def test_constants_stand_beside_what_the_system_states(tmp_path: Path) -> None:
    base = {"value": 0.302, "low": 0.300, "high": 0.304, "unit": "m"}
    write_page(result(constants={"base_m": base}, stated={"base_m": 0.325}), tmp_path)
    page = (tmp_path / "report.html").read_text("utf-8")
    for cell in ("base_m", "0.325 m", "0.3020 m (0.3000 to 0.3040)"):
        assert f">{cell}</" in page


@pytest.mark.whole
def test_no_place_beside_large_residuals_is_no_agreement(friction, tmp_path) -> None:
    assert "No single place stands out (q ≤ 0.05; the clearest has q = 0.3)" in friction[1]
    assert "the mean residual over a part of a coordinate reaches 31 mm (cart_m)" in friction[1]
    found = read(result(where=[place(0.01), place(0.02)], maps=[mapped(0.01)]), tmp_path)[1]
    assert "2 places stand out (q ≤ 0.05)." in found
    assert "No single place" not in found
    nothing = read(result(verdict="none", effects=[]), tmp_path)[1]
    assert "They disagree all the same" not in nothing


@pytest.mark.parametrize(
    ("count", "over"), [(4, "every coordinate."), (9, "the coordinates where it")]
)
def test_the_caption_counts_as_the_figure_does(count: int, over: str, tmp_path: Path) -> None:
    told = result()
    places = [profile(f"c{i}", 0.02) for i in range(count)]
    shown = told.shown.model_dump() | {"places": places}
    assert f"before and after, over {over}" in read(result(shown=shown), tmp_path)[1]


def test_a_table_is_not_told_again_in_sentences(friction) -> None:
    _, words = friction
    assert words.count("1.26 N (1.01 to 1.51)") == 3  # a tile, the sizes, the ranking
    assert "over 99 %" in words
    assert "100 %" not in words
    assert "rms forecast error" not in words


def test_every_negative_number_has_a_minus_sign(friction) -> None:
    assert "it gains −1.4 nats" in friction[1]
    assert not re.search(r"(?<![\w-])-\d", friction[1])


def test_a_point_of_the_forecast_says_its_value(friction) -> None:
    assert "with what was found: −0.19 at time in block 2 of 2 of a [s] 0.2" in friction[1]


def test_a_row_of_the_ranking_says_its_gain(friction) -> None:
    assert f"<title>{FRICTION}: 90 nats (80 to 100)</title>" in friction[0]


def test_a_user_s_own_effect_has_its_name_alone(tmp_path) -> None:
    assert plain("evaporation") == "`evaporation`"
    assert plain("gain@u") == "a gain by which u acts more, or less, than it says (`gain@u`)"
    own = result().effects[0].model_copy(update={"name": "evaporation"})
    told = result().model_copy(update={"effects": [own]})
    assert first_screen(told)[0] == "The system lacks `evaporation`."


def test_what_is_sure_stands_before_a_class(tmp_path) -> None:
    """Friction is sure; of a drag and a gain one is there, and the logs cannot say which."""
    drag = result().effects[0].model_copy(update={"name": "quadratic-drag@speed_mps"})
    rivals = ["quadratic-drag@speed_mps", "gain@motor_v"]
    of_class = {"verdict": "class", "rivals": rivals}
    alone = result().model_copy(update=of_class | {"effects": [drag]})
    both = alone.model_copy(update={"effects": [*result().effects, drag]})
    assert first_screen(alone)[0].startswith("The system lacks one of these: drag ")
    said = first_screen(both)[0]
    assert said.startswith("The system lacks dry friction that acts on speed_mps")
    assert ", and one of these: drag " in said
    assert said.count("dry friction") == 1
    assert "lacks dry friction that acts on speed_mps" in read(both, tmp_path)[1]


@pytest.mark.parametrize("verdict", ["named", "none", "unknown"])
def test_a_constant_that_was_moved_far_comes_before_any_answer(verdict: str) -> None:
    mass = {"value": 2.5, "low": 2.4, "high": 2.6, "unit": "kg"}
    push = {"value": 0.3, "low": 0.2, "high": 0.4, "unit": "N/V"}
    told = result(
        moved={"mass_kg": 5.2, "push_n_per_v": -7.4},
        constants={"mass_kg": mass, "push_n_per_v": push},
        stated={"mass_kg": 2.0, "push_n_per_v": 1.0},
        verdict=verdict,
    )
    first, second, *_ = screen = first_screen(told)
    mass_moved, push_moved = "mass_kg (from 2 kg to 2.5 kg)", "push_n_per_v (from 1 N/V to 0.3 N/V)"
    assert f"moved {mass_moved} by 5 and {push_moved} by 7 of the spreads" in first
    assert sum("search moved" in line for line in screen) == 1
    answer = first_screen(result(verdict=verdict))[0]
    with_it = "With that, nothing else that matters is missing from the system."
    assert second == (with_it if verdict == "none" else answer)
    assert "Not before constants and units" in screen[3]


def test_every_kind_says_what_it_is_at_its_port() -> None:
    for kind in (kind for kinds in KINDS_BY_ROLE.values() for kind in kinds):
        between = "-from-u" if "other" in kind.needs else ""
        words = plain(f"{kind.name}{between}@some_port")
        assert "some_port (`" in words or " some_port " in words
        assert (" u " in words) == bool(between)


def test_a_domains_page_says_whether_halves_agree(tmp_path) -> None:
    """It has no remarks of its own."""
    half = {"leading": FRICTION, "gain_nats": 9.0, "near": [FRICTION], "parameter": "force",
            "low": 1.0, "high": 1.5, "unit": "N", "episodes": ["a 1/2"]}  # fmt: skip
    told = result(repeated={"agree": True, "halves": [half, half]})
    said = f"Both halves of the logs say so by themselves: {FRICTION} (force from 1.00 to 1.50 N)"
    assert said in html.unescape(write_page(told, tmp_path).read_text("utf-8"))
    assert read(told, tmp_path)[1].count("Both halves of the logs say so by themselves") == 1
