"""The ranking as a chart: who is in it, in which colour, and over which axis."""

import math

from wakedeploy.core.dot_chart import BLUE, GREY, ORANGE
from wakedeploy.gap.report.ranking_chart import ranking_charts
from wakedeploy.gap.systems.gantry.findings import Ranked, Round


def ranked(name: str, gain: float) -> Ranked:
    return Ranked(name=name, gain_nats=gain, interval=(gain - 2.0, gain + 2.0), parameters={})


def searched(*gains: float, given: tuple[str, ...] = ()) -> Round:
    ranking = [ranked(f"e{at}", gain) for at, gain in enumerate(gains)]
    return Round(given=list(given), threshold_nats=6.0, ranking=ranking)


def test_the_best_is_on_top_and_says_its_gain_with_interval() -> None:
    (chart,) = ranking_charts([searched(3.0, math.nan, 40.0, 9.0)], ["e2"], [])
    assert [dot.name for dot in chart.dots] == ["e2", "e3", "e0"]
    assert [dot.colour for dot in chart.dots] == [ORANGE, BLUE, GREY]
    assert chart.dots[0].says == "e2: 40.0 nats (38.0 to 42.0)"
    assert (chart.limit, chart.limit_says) == (6.0, "threshold, 6.0 nats")
    assert chart.title == "On top of the model as it is (best 3 of 4)"


def test_a_class_has_its_colour_from_the_round_in_which_its_best_passed() -> None:
    below, above = ranking_charts([searched(3.0, 2.0), searched(9.0, 2.0)], [], ["e0", "e1"])
    assert {dot.colour for dot in below.dots} == {GREY}
    assert {dot.colour for dot in above.dots} == {ORANGE}


def test_one_that_outgrows_the_rest_bends_the_axis() -> None:
    usual, outgrown = ranking_charts([searched(30.0), searched(300.0, given=("e9",))], [], [])
    assert math.isinf(usual.linear)
    assert outgrown.linear == 12.0
    assert outgrown.title == "On top of e9"


def test_later_rounds_show_ten_and_a_round_without_a_gain_is_left_out() -> None:
    many = tuple(map(float, range(40)))
    first, second = ranking_charts([searched(math.nan), searched(*many), searched(*many)], [], [])
    assert (len(first.dots), len(second.dots)) == (30, 10)


def test_of_one_flight_nothing_was_held_out() -> None:
    (several,), (one,) = (ranking_charts([searched(3.0)], [], [], n) for n in (2, 1))
    assert "held-out" in several.x_label
    assert "held-out" not in one.x_label


def test_what_needs_less_than_the_threshold_is_drawn_as_evident() -> None:
    steady = ranked("steady", 12.0).model_copy(update={"needed_nats": 3.0})
    found = Round(given=[], threshold_nats=26.0, ranking=[steady, ranked("loud", 11.0)])
    (chart,) = ranking_charts([found], found={"steady"}, rivals=set())
    assert [dot.colour for dot in chart.dots] == [ORANGE, GREY]
