"""What the first screen says of an answer: which outputs gain, which lose, in plain words."""

from typing import Any

import pytest

from tests.gap.report.test_system_page import result
from wakedeploy.gap.search.outcome import CHANCE, HARDLY
from wakedeploy.gap.systems.answers.words import first_screen, sentences

LAG = "lag@steer_rad"
SHARE = {"share": 0.5, "low": 0.41, "high": 0.59}


def told(gap: dict[str, tuple[float, float]], **changed: object) -> list[str]:
    """The screen of an answer whose outputs, in rad, erred so before and after."""
    errors = {n: {"before": b, "after": a, "unit": "rad"} for n, (b, a) in gap.items()}
    return sentences(result(gap=errors, **changed))


def matters(gap: dict[str, tuple[float, float]], **changed: object) -> str:
    (line,) = [x for x in told(gap, **changed) if x.startswith("Does it matter? ")]
    return line.removeprefix("Does it matter? ")


def test_of_one_output_both_errors_are_told() -> None:
    assert matters({"cart": (0.47, 0.015)}) == (
        "Yes. With it, forecasts 0.90 s ahead of blocks kept apart are off by less: cart by "
        "0.0150 rad instead of 0.47 rad."
    )


def test_only_outputs_that_change_are_named_what_gains_most_first() -> None:
    said = matters({"a": (1.0, 0.99), "b": (1.0, 0.6), "c": (1.0, 0.1), "d": (1.0, 1.01)})
    assert said.endswith(
        "are off by less: c by 0.100 rad instead of 1.00 rad and b by 0.60 rad instead of 1.00 "
        "rad. The others hardly change."
    )


def test_where_nothing_is_missing_it_is_said_that_forecasts_err_far_more_than_a_sensor() -> None:
    noise = {"noise.a": {"value": 0.01, "unit": "rad"}, "noise.b": {"value": 0.1, "unit": "rad"}}
    nothing = {"verdict": "none", "effects": [], "noise": noise}
    far = matters({"a": (0.27, 0.27), "b": (0.2, 0.2)}, **nothing)
    assert (
        "That is 27 times what the sensor of a errs: as in a system that lets small errors grow"
        in far
    )
    assert "times what the sensor" not in matters({"a": (0.05, 0.05), "b": (0.2, 0.2)}, **nothing)


def test_an_output_that_gets_worse_is_named() -> None:
    said = matters({"speed": (0.0191, 0.0207), "gyro": (0.116, 0.0117)})
    assert "off by less: gyro by 0.0117 rad instead of 0.116 rad." in said
    assert said.endswith("speed gets worse: off by 0.0207 rad instead of 0.0191 rad.")


def test_of_many_outputs_three_are_named() -> None:
    said = matters({f"q{i}": (1.0, 0.1 + 0.05 * i) for i in range(6)})
    assert "q2 by 0.200 rad instead of 1.00 rad and 3 more." in said
    assert "q3" not in said


def test_the_effects_are_listed_once() -> None:
    effects = [
        {"name": name, "parameters": {}, "forecast": SHARE} for name in (LAG, "drag@v", "gain@v")
    ]
    said = matters({"a": (1.0, 0.1), "b": (1.0, 0.2), "c": (1.0, 0.3)}, effects=effects)
    assert said.startswith(f"Yes. With `{LAG}`, `drag@v` and `gain@v`, forecasts")
    assert said.count(LAG) == 1


@pytest.mark.parametrize(
    ("gap", "said"),
    [
        ({"a": (1.0, 0.97), "b": (1.0, 1.0)}, "Hardly. With it, forecasts 0.90 s ahead of blocks "
         "kept apart change by a trifle: a is off by 0.97 rad instead of 1.00 rad."),
        ({"a": (1.0, 1.3)}, "Forecasts 0.90 s ahead of blocks kept apart get no better with it. a "
         "gets worse: off by 1.30 rad instead of 1.00 rad."),
        ({"a": (0.0, 0.0), "b": (1.0, 0.5)}, "Yes. With it, forecasts 0.90 s ahead of blocks kept "
         "apart are off by less: b by 0.50 rad instead of 1.00 rad. The others hardly change."),
        ({"a": (float("nan"), float("nan")), "b": (1.0, 0.5)}, "Yes. With it, forecasts 0.90 s "
         "ahead of blocks kept apart are off by less: b by 0.50 rad instead of 1.00 rad."),
    ],
)  # fmt: skip
def test_what_gains_little_or_nothing_is_said_as_it_is(
    gap: dict[str, tuple[float, float]], said: str
) -> None:
    assert matters(gap) == said


def removes(gap: dict[str, tuple[float, float]], **changed: object) -> str:
    effect = {"name": LAG, "parameters": {}, "forecast": SHARE}
    screen = told(gap, **({"effects": [effect]} | changed))
    (line,) = [line for line in screen if line.startswith(f"  {LAG}: ")]
    return line.removeprefix(f"  {LAG}: ")


def test_of_one_output_the_share_is_that_outputs() -> None:
    assert removes({"a": (1.0, 0.7)}) == (
        "removes 50 % (41 % to 59 %) of the squared forecast error where it was not fitted."
    )


def test_of_several_outputs_the_share_is_told_of_the_one_that_gains_most() -> None:
    """Half of the error of two outputs is all of one: the mean alone hides that."""
    assert removes({"speed": (0.0191, 0.0207), "gyro": (0.4, 0.04)}) == (
        "removes 99 % of the squared forecast error of gyro on blocks kept apart; as a mean over "
        "the 2 outputs 50 % (41 % to 59 %) where it was not fitted."
    )
    screen = told({"speed": (0.02, 0.022), "gyro": (0.4, 0.04)})
    assert (
        "  gyro: rms forecast error 0.40 rad before, 0.040 rad after; its square falls by 99 %"
        in screen
    )
    assert (
        "  speed: rms forecast error 0.0200 rad before, 0.0220 rad after; its square grows by 21 %"
        in screen
    )


def test_of_several_effects_no_output_is_given_to_one() -> None:
    effects = [{"name": name, "parameters": {}, "forecast": SHARE} for name in (LAG, "gain@v")]
    assert removes({"a": (1.0, 0.9), "b": (1.0, 0.1)}, effects=effects) == (
        "removes 50 % (41 % to 59 %) of the squared forecast error where it was not fitted, as a "
        "mean over the 2 outputs."
    )


BASE = {"value": 0.3019, "low": 0.3005, "high": 0.3033, "unit": "m"}
TOP = {"value": 4.0, "low": 3.9, "high": 4.1, "unit": "m/s"}
MOVED = {
    "constants": {"wheelbase_m": BASE, "top_mps": TOP},
    "stated": {"wheelbase_m": 0.325, "top_mps": 4.0},
    "moved": {"wheelbase_m": -4.6},
}


def ranked(gains: dict[str, float], given: list[str], needed_nats: float = 5.0) -> dict[str, Any]:
    ranking = [
        {
            "name": n,
            "gain_nats": g,
            "needed_nats": needed_nats,
            "interval": [g, g],
            "parameters": {},
        }
        for n, g in gains.items()
    ]
    return {"given": given, "threshold_nats": 5.0, "steady_nats": 5.0, "ranking": ranking}


def test_a_constant_that_moved_is_told_from_where_to_where() -> None:
    doubt = sentences(result(**MOVED))[0]
    assert doubt.startswith(
        "Doubt what follows: to fit, the search moved wheelbase_m (from 0.325 m to 0.3019 m) by 5 "
        "of the spreads that the system states. A unit may be wrong, there or of a column, or "
        "there is a load that the system does not have."
    )


def test_a_gain_that_stands_unnamed_beside_it_may_be_what_moved_it() -> None:
    rounds = [
        ranked({"sensor-gain@early": 50.0}, []),
        ranked({"sensor-gain@gyro": 10.4, "gain@steer": 0.3, "lag@steer": 8.0}, ["drag@v"]),
    ]
    doubt = sentences(result(**MOVED, rounds=rounds))[0]
    assert doubt.endswith(
        "Or it stands for an effect that was ranked and not named: `sensor-gain@gyro`."
    )
    quiet = [ranked({"sensor-gain@gyro": 0.4}, [])]
    assert "Or it stands" not in sentences(result(**MOVED, rounds=quiet))[0]


def test_an_effect_that_is_not_named_is_listed_although_others_were_tried_beside_it() -> None:
    """A stop that is evident, and what was evident beside the stop alone."""
    rounds = [ranked({LAG: 90.0}, []), ranked({"stop@v": 80.0}, [LAG])]
    rounds.append(ranked({"offset@v": 40.0}, [LAG, "stop@v"]))
    for searched in rounds[1:]:
        searched["ranking"][0]["judged"] = HARDLY
    effects = [{"name": LAG, "parameters": {}, "forecast": SHARE}]
    screen = " ".join(sentences(result(effects=effects, rounds=rounds)))
    assert f"Not named: stop@v: {HARDLY}." in screen
    assert "offset@v" not in screen


def test_of_what_was_not_asked_since_the_last_name_that_is_said() -> None:
    """An answer names no more; beside the last one it might matter."""
    last = ranked({"stop@v": 80.0, "offset@v": 40.0}, [LAG])
    last["ranking"][1]["judged"] = HARDLY
    last["chosen"] = "stop@v"
    effects = [{"name": n, "parameters": {}, "forecast": SHARE} for n in (LAG, "stop@v")]
    screen = " ".join(sentences(result(effects=effects, rounds=[ranked({LAG: 90.0}, []), last])))
    assert (
        f"Not named: offset@v: before `stop@v` was named, and not asked since: {HARDLY}." in screen
    )


@pytest.mark.parametrize(
    ("by_s", "said"),
    [
        ((0.01, 0.008, 0.012), "acts 10.0 ms (8.0 to 12.0) after its stamps, which the fit took"),
        ((-0.01, -0.012, -0.008), "acts 10.0 ms (8.0 to 12.0) before its stamps, which"),
    ],
)
def test_what_a_fit_took_for_the_log_s_clock_is_said(by_s, said: str) -> None:
    value, low, high = by_s
    shifted = {"bow": {"value": value, "low": low, "high": high, "unit": "s"}}
    effects = [{"name": LAG, "parameters": {}, "forecast": SHARE}]
    screen = " ".join(sentences(result(effects=effects, shifted=shifted)))
    assert f"bow {said}" in screen
    assert ("that is a delay of the system" in screen) is (value > 0.0)


def test_inputs_of_one_clock_are_told_together() -> None:
    by = {"value": 0.01, "low": 0.008, "high": 0.012, "unit": "s"}
    other = {"value": -0.004, "low": -0.005, "high": -0.003, "unit": "s"}
    effects = [{"name": LAG, "parameters": {}, "forecast": SHARE}]
    shifted = {"bow": by, "wind": other, "stern": by}
    screen = " ".join(sentences(result(effects=effects, shifted=shifted)))
    assert "bow and stern act 10.0 ms (8.0 to 12.0) after their stamps, which" in screen
    assert "wind acts 4.0 ms (3.0 to 5.0) before its stamps, which" in screen


def test_a_rival_is_not_listed_as_unnamed() -> None:
    """It alone improves forecasts hardly, and still no log tells it from the one that does."""
    first = ranked({"mass@v": 40.0, LAG: 90.0, "stop@v": 20.0}, [])
    for entry in first["ranking"][1:]:
        entry["judged"] = HARDLY
    effects = [{"name": "mass@v", "parameters": {}, "forecast": SHARE}]
    rivals = {"verdict": "class", "class": ["mass@v", LAG]}
    screen = " ".join(sentences(result(effects=effects, rounds=[first], **rivals)))
    assert "Not named: stop@v" in screen
    assert f"Not named: {LAG}" not in screen


def test_an_effect_that_outlived_the_first_one_is_not_listed_as_unnamed() -> None:
    """The lag went once the stop explained it; beside nothing, the stop had hardly told."""
    first = ranked({LAG: 90.0, "stop@v": 40.0}, [])
    first["ranking"][1]["judged"] = HARDLY
    rounds = [first, ranked({"stop@v": 80.0}, [LAG]), ranked({}, [LAG, "stop@v"])]
    effects = [{"name": "stop@v", "parameters": {}, "forecast": SHARE}]
    assert "Not named: stop@v" not in " ".join(sentences(result(effects=effects, rounds=rounds)))


@pytest.mark.parametrize(("gained_nats", "is_near"), [(90.0, True), (4.0, False)])
def test_where_nothing_is_named_what_uneven_noise_keeps_from_being_evident_is_told(
    gained_nats: float, is_near: bool
) -> None:
    """Ninety nats are no proof where luck may bring 133, and no sign that nothing is missing."""
    searched = ranked({"stop@v": gained_nats}, [], needed_nats=133.0)
    searched["threshold_nats"], searched["ranking"][0]["judged"] = 133.0, CHANCE
    nothing = result(verdict="none", effects=[], rounds=[searched])
    screen = " ".join(sentences(nothing))
    assert screen.startswith("Nothing that matters is missing")
    near = (
        "Nearest to evident: stop@v gains 90.0 nats; even noise brings up to 5.0 nats, but noise "
        "as loud now and then, or as lasting, as in these logs up to 133.0 nats."
    )
    assert (near in screen) == is_near
    assert ("How sure is that? Less than usual: more than even noise acts" in screen) == is_near
    assert ("Record more of the moments in which `stop@v` would act" in screen) == is_near
    named = result(effects=[{"name": LAG, "parameters": {}, "forecast": SHARE}], rounds=[searched])
    assert "Nearest" not in " ".join(sentences(named))


@pytest.mark.parametrize(("needed_nats", "clear"), [(2.0, True), (5.0, False)])
def test_an_unknown_is_clear_where_an_effect_gains_what_it_has_to(
    needed_nats: float, clear: bool
) -> None:
    """Three nats are less than chance brings, and enough of an effect that gains steadily."""
    rounds = [ranked({"lag@steer": 3.0}, [], needed_nats)]
    screen = " ".join(first_screen(result(verdict="unknown", effects=[], rounds=rounds)))
    assert ("finds something this clear" in screen) == clear
    assert ("more than the sensors' noise" in screen) != clear


def test_a_constant_that_ends_at_its_bound_says_so_and_that_its_sign_may_be_wrong() -> None:
    ends = {"drag": (0.001, 0.001, 0.6), "mass": (9.0, 3.0, 9.0), "gain": (0.5, 0.001, 0.9)}
    constants = {
        name: {"value": value, "low": low, "high": high, "unit": "1"}
        for name, (value, low, high) in ends.items()
    }
    lines = sentences(result(constants=constants, stated=dict.fromkeys(ends, 1.0)))
    (drag,), (mass,), (gain,) = ([x for x in lines if x.startswith(f"    {n}")] for n in ends)
    assert drag.endswith(", as far towards 0 as it may go")
    assert mass.endswith(", as far as it may go")
    assert gain.endswith(")")


def test_constants_as_fitted_stand_in_the_details() -> None:
    screen = sentences(result(**MOVED))
    at = screen.index("  Constants, as fitted beside it:")
    assert screen[at + 1 : at + 3] == [
        "    wheelbase_m: stated 0.325 m, fitted 0.3019 m (0.3005 to 0.3033)",
        "    top_mps: stated 4 m/s, fitted 4.00 m/s (3.90 to 4.10)",
    ]
    names = [f"k{i}_m" for i in range(30)]
    many = {"constants": dict.fromkeys(names, BASE), "stated": dict.fromkeys(names, 0.3)}
    lines = sentences(result(**many))
    assert sum(line.startswith("    k") for line in lines) == 12
    assert "    and 18 more, in the report" in lines
    alone = sentences(result(verdict="unknown", effects=[], **MOVED))
    assert "  Constants, as fitted:" in alone
    assert not any("Constants" in line for line in sentences(result(verdict="none", effects=[])))


@pytest.mark.parametrize("unit", ["1", ""])
def test_no_unit_stands_behind_a_pure_number(unit: str) -> None:
    follows = {"coordinate": "command", "unit": unit, "share": 0.6}
    against = {**follows, "edges": [-1.2, 0.0, 1.8], "means": [-3.0, 2.0]}
    push = {
        "state": "spin",
        "sd": 1.0,
        "unit": "1/s",
        "lasts_s": 0.7,
        "share": 5.0,
        "of_parts": 5.0,
    }
    lines = told({"a": (1.0, 0.1)}, unexplained=[{**push, "matters": True, "against": against}])
    (said,) = [line for line in lines if "It follows command" in line]
    assert said.endswith("from −3 1/s at −1.2 to +2 1/s at 1.8.")


def halved(agree: bool, *spans: tuple[float, float]) -> dict[str, object]:
    halves = [
        {"leading": LAG, "gain_nats": 9.0, "near": [LAG], "parameter": "tau_s", "low": low,
         "high": high, "unit": "s", "episodes": ["a 1/2"]}
        for low, high in spans
    ]  # fmt: skip
    return {"repeated": {"agree": agree, "halves": halves}}


def test_halves_that_agree_are_told_with_their_sizes() -> None:
    said = told({"a": (1.0, 0.5)}, **halved(True, (0.1, 0.14), (0.09, 0.12)))
    assert (
        f"  Both halves of the logs say so by themselves: {LAG} (tau from 100 to 140 ms); and "
        f"{LAG} (tau from 90 to 120 ms)."
    ) in said
    (sure,) = [line for line in said if line.startswith("How sure is that? ")]
    assert "bear it out. Each half of the logs by itself says the same." in sure


def test_of_several_effects_halves_speak_of_the_first() -> None:
    effects = [{"name": n, "parameters": {}, "forecast": SHARE} for n in (LAG, "drag@v")]
    said = told({"a": (1.0, 0.5)}, effects=effects, **halved(True, (0.1, 0.14), (0.09, 0.12)))
    words = f"Each half of the logs by itself says the same of `{LAG}`, and was asked no further."
    assert any(words in x for x in said)


def test_in_a_class_halves_say_no_more_and_what_they_leave_open() -> None:
    halves = halved(True, (0.1, 0.2), (0.12, 0.22))
    for half in halves["repeated"]["halves"]:
        half["near"] = [LAG, "sensor-lag@yaw"]
    lines = told(
        {"cart": (0.47, 0.015)}, verdict="class", **{"class": [LAG, "sensor-lag@yaw"]}, **halves
    )
    text = "\n".join(lines)
    assert "Each half of the logs by itself says no more." in text
    assert text.count("or sensor-lag@yaw") >= 2
    assert f"or sensor-lag@yaw; and {LAG} (" in text


def test_a_name_that_may_stand_for_a_lag_behind_a_curve_is_doubted_and_the_law_comes_next() -> None:
    text = "\n".join(told({"cart": (0.47, 0.015)}, curved=["pulse_us"]))
    assert "But pulse_us acts by a curve: what lags behind that" in text
    assert "What next? State what the law makes of pulse_us as an input of its own" in text
    assert "use the corrected system" not in text
    assert "by a curve" not in "\n".join(told({"cart": (0.47, 0.015)}))


@pytest.mark.parametrize(
    ("answered", "is_doubted"),
    [
        ({"drag@v": 1.0, "added-inertia@v": 0.29}, True),
        ({"added-inertia@v": 0.77}, False),
        ({"added-inertia@v": 2.0}, False),
        ({}, False),
    ],
)
def test_an_effect_by_which_inputs_do_far_less_may_stand_for_a_force_that_is_held_against(
    answered: dict[str, float], is_doubted: bool
) -> None:
    said = " ".join(first_screen(result(answered=answered)))
    assert ("a force that stands in no column" in said) is is_doubted
    assert ("with `added-inertia@v` inputs do 29 % of what" in said) is is_doubted


@pytest.mark.parametrize(
    ("name", "parameter", "value", "is_doubted"),
    [
        ("sensor-dead-time@x", "delay_s", 2.0, True),
        ("sensor-dead-time@x", "delay_s", 1.95, False),
        ("stiffness@v", "stiffness", 1.9, True),  # to either side
        ("sensor-floor@x", "limit", 2.0, False),  # where the lowest reading is
        ("sensor-gain@x", "error", 1.9, True),  # a library's -0.9 says nothing
        ("scale@c", "error", 1.9, True),
        ("added-inertia@v", "ratio", 1.9, True),
        ("lag@u", "tau_s", 1.9, False),  # no lag
        ("gain@u", "error", 1.9, False),  # nothing arrives: that is an end by itself
    ],
)
def test_a_size_that_went_as_far_as_the_library_lets_it_is_doubted(
    name: str, parameter: str, value: float, is_doubted: bool
) -> None:
    size = {"value": value, "low": 1.9, "high": 2.0, "unit": "s"}
    effects = [{"name": name, "parameters": {parameter: size}, "forecast": SHARE}]
    said = " ".join(first_screen(result(effects=effects)))
    assert ("something else that looks like it" in said) is is_doubted


def test_halves_that_do_not_agree_ask_for_more_logs() -> None:
    said = told({"a": (1.0, 0.5)}, **halved(False, (0.1, 0.14), (0.19, 0.22)))
    (line,) = [x for x in said if "The two halves of the logs do not agree: lag@" in x]
    assert line.endswith("More logs would tell.")
    assert any("The two halves of the logs do not agree: record more." in x for x in said)


def test_where_no_half_was_asked_nothing_is_said_of_halves() -> None:
    assert not any("half" in line or "halves" in line for line in told({"a": (1.0, 0.5)}))


def test_a_constant_that_the_logs_say_nothing_of_is_told_so() -> None:
    unknown = {"wall_mm": {"value": 3.0, "unit": "mm"}}
    for verdict in ({}, {"verdict": "none", "effects": []}):
        said = "\n".join(told({"cart": (0.47, 0.015)}, unknown=unknown, **verdict))
        assert (
            "not known from these logs, as no output shows them, and stay as stated: wall_mm."
            in said
        )
