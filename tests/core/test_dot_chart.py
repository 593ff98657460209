"""Rows of values as a drawing: places, words below the axis, and what a row says."""

import math
import re
from itertools import pairwise

import pytest

from wakedeploy.core import pages
from wakedeploy.core.dot_chart import GREY, ORANGE, Dot, DotChart

NAN = math.nan


def chart(*dots: Dot, **more: float) -> DotChart:
    return DotChart("On top of nothing", "gain [nats]", dots, **more)


def drawn(*charts: DotChart) -> str:
    macros = pages._environment("wakedeploy.core").get_template("parts.html").module
    return str(macros.dots(charts, "What each gains."))


def test_a_linear_axis_has_equal_distances_and_room_at_its_ends() -> None:
    made = chart(Dot("a", 3.0, -10.0, 30.0, ""))
    ends = [made.across(value) for value in (-10.0, 0.0, 10.0, 20.0, 30.0)]
    steps = [b - a for a, b in pairwise(ends)]
    assert max(steps) - min(steps) <= 0.2  # places have one decimal
    assert made.x_left < ends[0] < ends[-1] < made.x_right


def test_beyond_its_linear_part_each_decade_is_as_long_as_that_part() -> None:
    made = chart(Dot("a", 900.0, -150.0, 2000.0, ""), linear=20.0)
    zero, first, second, third = (made.across(value) for value in (0.0, 20.0, 200.0, 2000.0))
    assert second - first == pytest.approx(first - zero, abs=0.2)
    assert third - second == pytest.approx(first - zero, abs=0.2)
    assert zero - made.across(-20.0) == pytest.approx(first - zero, abs=0.2)


@pytest.mark.parametrize("linear", [math.inf, 20.0])
@pytest.mark.parametrize("largest", [1e-3, 7.0, 3e3, 1e15])
def test_words_below_the_axis_do_not_touch_and_zero_is_one_of_them(linear, largest) -> None:
    made = chart(Dot("a", largest, -largest / 3, largest, ""), linear=max(linear, largest / 1e12))
    places = sorted(place for place, _ in made.ticks)
    assert len(places) > 1
    assert min(b - a for a, b in pairwise(places)) >= 46
    assert (made.across(0.0), "0") in made.ticks
    assert not any("-" in word.replace("e-", "") for _, word in made.ticks)


def test_a_row_says_its_numbers_and_has_an_interval_only_where_there_is_one() -> None:
    rows = [Dot("a<b", 9.0, 8.0, 10.0, "a<b: 9 nats (8 to 10)", ORANGE, True)]
    rows.append(Dot("c", 1.0, NAN, NAN, "c: 1 nats", GREY))
    text = drawn(chart(*rows, limit=6.0, limit_says="threshold, 6.0 nats"))
    assert re.findall(r"<title>(.*?)</title>", text) == ["a&lt;b: 9 nats (8 to 10)", "c: 1 nats"]
    assert re.findall(r'class="row ([\w-]+)"', text) == ["of-1", "of-rest"]
    assert text.count('class="interval"') == 1
    assert text.count('class="mark"') == 2
    assert text.count('class="limit"') == 1
    assert "nan" not in text.lower()


def test_a_long_name_is_cut_and_said_whole() -> None:
    name = 30 * "name"
    text = drawn(chart(Dot(name, 1.0, 0.0, 2.0, f"{name}: 1 nats")))
    assert text.count(name) == 1
    assert f"{name[:31]}…</text>" in text


def test_a_note_stands_on_the_side_where_there_is_room() -> None:
    unseen, far = (
        Dot("a", NAN, NAN, NAN, "", note="never"),
        Dot("b", 9.0, 9.0, 9.0, "", note="never named"),
    )
    first, second = chart(unseen, far).rows
    assert (first.x, first.ends, first.note_anchor) == (None, None, "start")
    assert (second.note_anchor, second.note_x < second.x) == ("end", True)


def test_nothing_known_is_no_figure() -> None:
    assert drawn().strip() == ""
