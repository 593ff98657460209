"""What to do about an unknown: what is most useful here, and where all ways stand."""

import re
import shlex
from pathlib import Path

import pytest

from tests.gap.report.test_system_page import result
from wakedeploy.gap.systems.answers.next_commands import next_commands
from wakedeploy.gap.systems.answers.words import first_screen, next_step, sentences

ROOT = Path(__file__).resolve().parents[4]
PAGE = "docs/how-to/unknown.md"
LAW = {"coordinate": "yaw_rad", "by_direction": False, "removes": 0.5, "low": 0.32, "high": 0.69}


def push(state: str = "speed_mps", **changed: object) -> dict[str, object]:
    return {"state": state, "sd": 0.45, "unit": "m/s/s", "lasts_s": 4.7, "share": 0.5,
            "of_parts": 0.4, "matters": True} | changed  # fmt: skip


def unknown(**changed: object):
    return result(**({"verdict": "unknown", "effects": []} | changed))


def test_a_law_over_a_coordinate_is_a_term_to_write() -> None:
    small = LAW | {"coordinate": "left_v", "removes": 0.09}
    step = next_step(unknown(unexplained=[push("turn_radps", law=small), push(law=LAW)]))
    assert step.startswith(
        "Write the term that is missing: what acts on speed_mps follows yaw_rad, which the rate of "
        "speed_mps in your equations does not have, or not so."
    )


def test_a_name_that_leaves_a_law_is_not_all_of_it() -> None:
    """A drag that no port offered was named as friction and a limit that is not there."""
    most = LAW | {"coordinate": "speed_mps", "removes": 0.99, "low": 0.98}
    first = first_screen(result(unexplained=[push(law=most)]))
    assert first[0].endswith(
        "That is not all of it, or not its form: a law over speed_mps on speed_mps removes 99 % of "
        "the squared forecast error that is left."
    )
    assert first[-1].startswith("What next? Write the term that is missing: what acts on speed_mps")
    named, other = most | {"removes": 0.9, "low": 0.8}, most | {"removes": 0.6, "low": 0.55}
    beside = push("turn_radps", law=other, not_offered=["offset"])
    both = first_screen(result(unexplained=[push(law=named), beside]))  # of the same push
    assert "on speed_mps removes 90 %" in both[0]
    assert both[-1].startswith("What next? Write the term that is missing: what acts on speed_mps")
    for other in ([], [push()], [push(law=LAW)]):
        assert "not its form" not in first_screen(result(unexplained=other))[0]


@pytest.mark.parametrize("verdict", ["unknown", "named"])
def test_kinds_that_a_port_leaves_out_are_offered_first_where_a_law_says_nearly_all(
    verdict,
) -> None:
    most = LAW | {"coordinate": "speed_mps", "removes": 0.99, "low": 0.98}
    left = push(law=most, not_offered=["quadratic-drag", "hysteresis"])
    step = next_step(result(verdict=verdict, unexplained=[left]))
    assert step.startswith(
        "Let the search try more: what is left on speed_mps follows a law over speed_mps, and the "
        "port of speed_mps leaves out quadratic-drag and hysteresis. Add them to its kinds, and "
        "ask again."
    )
    portless = next_step(result(verdict=verdict, unexplained=[push(law=most, has_port=False)]))
    assert 'speed_mps has no port. Add Port.force("speed_mps", …), and ask again.' in portless
    for other in (push(law=most), push(law=LAW, not_offered=["quadratic-drag"]), push()):
        assert "Let the search" not in next_step(result(verdict=verdict, unexplained=[other]))


def test_a_push_without_a_law_is_something_to_log() -> None:
    no_use = LAW | {"removes": -0.1}
    for pushes in ([push()], [push(law=no_use)]):
        step = next_step(unknown(unexplained=pushes))
        assert step.startswith("Look for what acts on speed_mps and stands in no column")


@pytest.mark.parametrize("follows", [False, True])
def test_a_push_that_follows_a_coordinate_without_a_law_contradicts_nothing(follows: bool) -> None:
    against = {"coordinate": "yaw_rad", "unit": "rad", "share": 0.9, "edges": [0.0, 1.0],
               "means": [-1.0, 1.0]}  # fmt: skip
    told = sentences(unknown(unexplained=[push(**({"against": against} if follows else {}))]))
    (line,) = [x.strip() for x in told if "a disturbance acts so" in x]
    assert line.startswith("But forecasts bear out no law" if follows else "No law over one")


def test_a_push_that_a_servo_holds_against_is_not_more_than_the_system_does() -> None:
    """A joint stands still between its spring and dry friction, and its rate is next to nothing."""
    held = result(unexplained=[push(share=2.06, of_parts=0.18)])
    assert "units" not in next_step(held)
    assert "fewer than one search in twenty" in first_screen(held)[2]


def test_too_many_rivals_are_told_apart_by_an_input() -> None:
    rivals = ["a@x", "b@x", "c@x", "d@x"]
    answer = unknown(**{"class": rivals})
    assert next_step(answer).startswith("Record an input that tells these apart, if there is one.")
    (command,) = next_commands(answer, Path("r.py"), [Path("a.csv")], None, Path("gap"))
    assert shlex.split(command)[:3] == ["wakedeploy", "gap", "plan"]


def test_without_any_of_these_units_come_first() -> None:
    answer = unknown()
    assert next_step(answer).startswith("See whether units and samples are right")
    (command,) = next_commands(answer, Path("r.py"), [Path("a.csv")], None, Path("gap"))
    assert shlex.split(command)[:3] == ["wakedeploy", "gap", "check"]


@pytest.mark.parametrize("effects", [{}, {"verdict": "none", "effects": []}])
def test_a_push_larger_than_the_system_itself_sends_one_to_units_first(effects) -> None:
    """A depth in cm was named a lag of its sensor, with forecasts that get surely better by it."""
    given = (Path("r.py"), [Path("a.csv")], Path("c.toml"), Path("gap"))
    usual = result(unexplained=[push(share=0.91)], **effects)
    doubted = result(unexplained=[push("yaw"), push(share=5.48, of_parts=5.0)], **effects)
    step, after = next_step(usual), next_commands(usual, *given)
    assert "unit" not in step
    assert next_step(doubted).startswith("First check units, signs and columns: `gap check` prints")
    assert "left on speed_mps is more than all that the system itself does" in next_step(doubted)
    check = "wakedeploy gap check r.py --measured a.csv --columns c.toml"
    assert next_commands(doubted, *given) == [check, *after]
    moved = {"unexplained": [push(share=5.48, of_parts=5.0)], "moved": {"mass_kg": 9.0}}
    mass = {"value": 9.0, "low": 8.0, "high": 9.5, "unit": "kg"}
    bent = result(**moved, constants={"mass_kg": mass}, stated={"mass_kg": 1.0}, **effects)
    assert next_step(bent).startswith("Check what was moved, and the units")


def test_a_name_beside_such_a_push_is_not_said_to_be_sure() -> None:
    sure = "fewer than one search in twenty finds something this clear"
    assert sure in first_screen(result(unexplained=[push(share=0.91)]))[2]
    said = first_screen(result(unexplained=[push(share=5.48, of_parts=5.0)]))[2]
    assert sure not in said
    assert said.startswith("How sure is that? Not before units, signs and columns are known to be")
    assert "a push on speed_mps of 548 % of its usual rate is left" in said


@pytest.mark.parametrize(
    "changed", [{}, {"unexplained": [push()]}, {"class": ["a", "b", "c", "d"]}]
)
def test_every_unknown_points_to_the_page_that_has_all_ways(changed) -> None:
    step = next_step(unknown(**changed))
    assert f"{PAGE}#of-a-system-of-your-own" in step
    _, page = (ROOT / PAGE).read_text("utf-8").split("## Of a system of your own\n")
    ways = re.findall(r"^\d\. \*\*(.+)\.\*\*", page, re.MULTILINE)
    assert [way for way in ways if way.lower() not in step] == []
    assert len(ways) == 7


def test_of_an_unknown_no_error_stands_as_after() -> None:
    assert "  cart_m: rms forecast error 47 mm" in sentences(unknown())


def test_where_nothing_is_missing_constants_that_the_logs_know_better_are_to_be_stated() -> None:
    """By three standard errors of a 90 % interval: 0.125 s is eighteen, 3 kg less than two."""
    sizes = {
        "lag_s": {"value": 0.145, "low": 0.134, "high": 0.157, "unit": "s"},
        "mass_kg": {"value": 17.0, "low": 14.2, "high": 19.8, "unit": "kg"},
    }
    stated = {"lag_s": 0.02, "mass_kg": 14.0}
    quiet = result(verdict="none", effects=[], constants=sizes, stated=stated, moved={})
    assert next_step(quiet).startswith("State what was fitted for `lag_s`, which the logs know")
    told = "\n".join(sentences(quiet))
    assert "lag_s: stated 20 ms, fitted 145 ms (134 to 157)" in told
    assert "mass_kg: stated" not in told
    agreed = quiet.model_copy(update={"stated": stated | {"lag_s": 0.14}})
    assert next_step(agreed).startswith("Use the system as it is.")
    assert "Constants" not in "\n".join(sentences(agreed))


def test_a_constant_that_the_logs_know_to_a_thousandth_is_told_from_a_fiftieth_on() -> None:
    """A track that is 4 % wider turns a rover wrongly; 1 % may be the model's form."""
    width = {"value": 0.312, "low": 0.3116, "high": 0.3124, "unit": "m"}
    quiet = result(
        verdict="none", effects=[], constants={"track_m": width}, stated={"track_m": 0.3}, moved={}
    )
    assert next_step(quiet).startswith("State what was fitted for `track_m`, which the logs know")
    agreed = quiet.model_copy(update={"stated": {"track_m": 0.309}})
    assert next_step(agreed).startswith("Use the system as it is.")


def test_where_no_effect_is_named_what_is_left_stands_on_the_first_screen() -> None:
    """A rover that slips in turns, by a law over two coordinates, was to be used as it is."""
    quiet = result(
        verdict="none", effects=[], unexplained=[push("x_m", share=0.13), push("y_m", share=0.12)]
    )
    screen = first_screen(quiet)
    assert screen[0] == (
        "No effect that was tried is missing from the system. But something is left that none of "
        "them explains: on x_m (13 % of its usual rate) and y_m (12 % of its usual rate)."
    )
    assert screen[1].startswith("Does it matter? Of what was tried, nothing does. Forecasts")
    assert screen[3].startswith(
        "What next? If you know a law for what is left on x_m, give it as Port.custom, also one "
        "over several coordinates, and ask again; "
    )
    assert "says how. Until then use the system as it is. How small" in screen[3]
    assert first_screen(result(verdict="none", effects=[]))[0] == (
        "Nothing that matters is missing from the system."
    )
