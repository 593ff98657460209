"""A report in a browser: a click on a column's head sorts by it, and nothing else may run."""

import html
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import jinja2
import pytest

from wakedeploy.core import pages
from wakedeploy.core.line_chart import Curve, LineChart

CHROMIUM = shutil.which("chromium")
ROWS = [["a", "10"], ["b", "9.5"], ["c", "−3"], ["d", "1,200"], ["e", "–"]]
CLICK = "for (const e of '{0}') document.querySelectorAll('th')[1].click()"


def shown(tmp_path: Path, text: str) -> str:
    """The document as a browser has it after its scripts."""
    path = tmp_path / "page.html"
    path.write_text(text, "utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}/own"]
    told = subprocess.run(
        [CHROMIUM, *options, "--dump-dom", path.as_uri()],
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    return told.stdout


def a_page(table: pages.Table, title: str = "kept") -> str:
    """A study's page with one table."""
    part = {"name": "p", "title": "p", "sentence": "", "picture": None, "table": table}
    return pages.page(
        "wakedeploy.study", "study.html", title=title, parts=[part], sets=[], commit=None, next=[]
    )


def with_script(text: str, script: str) -> str:
    return text.replace("</body>", f"<script>{script}</script></body>")


def names(document: str) -> str:
    return "".join(re.findall(r"<tr><td>(\w)</td>", document))


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
@pytest.mark.parametrize(("clicks", "order"), [("", "abcde"), ("x", "cbade"), ("xx", "edabc")])
def test_a_column_is_sorted_by_the_size_of_its_numbers(
    clicks: str, order: str, tmp_path: Path
) -> None:
    text = a_page(pages.Table(["name", "gain"], ROWS))
    allowed = re.sub(r"<meta http-equiv[^>]*>", "", text)
    assert names(shown(tmp_path, with_script(allowed, CLICK.format(clicks)))) == order


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_no_other_script_runs(tmp_path: Path) -> None:
    text = a_page(pages.Table(["name"], [["a"]]))
    document = shown(tmp_path, with_script(text, "document.querySelector('h1').remove()"))
    assert "<h1>kept</h1>" in document
    assert 'tabindex="0"' in document


def test_a_hostile_name_in_a_file_does_not_become_html() -> None:
    evil = "<script>alert('x')</script><img src=x onerror=alert(1)>\" onload=\"alert(2)"
    text = a_page(pages.Table([evil], [[evil]]), title=evil)
    assert text.count("<script") == 1
    assert "<img" not in text
    assert ' onload="' not in text
    assert html.unescape(text).count(evil) == 4  # title, heading, head and cell


def test_tiles_stand_in_rows_of_one_length_and_an_interval_in_a_line_of_its_own() -> None:
    macros = pages._environment("wakedeploy.core").get_template("parts.html").module
    tiles = {n: macros.tiles([("up", "95 ms (81 to 110)")] * n) for n in (1, 3, 5, 6, 8, 9)}
    columns = {n: int(re.findall(r"--columns: (\d+)", made)[0]) for n, made in tiles.items()}
    assert columns == {1: 3, 3: 3, 5: 5, 6: 3, 8: 4, 9: 5}
    assert '<span class="ends">(81 to 110)</span>' in tiles[1]


def test_a_command_breaks_between_words_alone() -> None:
    command = "wakedeploy gap plan --write-reference 'a <b>.csv'"
    made = pages.unbroken(command)
    assert "<span>--write-reference</span>" in made
    assert html.unescape(re.sub(r"</?span>", "", made)) == command


def test_names_in_a_sentence_are_code_and_nothing_else_is_markup() -> None:
    assert pages.prose("`a<b` & c") == "<code>a&lt;b</code> &amp; c"


def test_a_chart_has_minus_signs() -> None:
    chart = LineChart([Curve("u", [0.0, 1.0], [-2.0, 1.0])], "t [s]", "u [V]")
    assert "−2" in [word for _, word in chart.y_ticks]
    assert chart.lines[0][2][0][2] == "u: −2 at t [s] 0"


def test_a_chart_asks_for_each_value_a_few_times_only() -> None:
    """Each point's place had asked for the ranges, and these for every value."""

    class Counted(list[float]):
        asked = 0

        def __iter__(self) -> Iterator[float]:
            type(self).asked += len(self)
            return super().__iter__()

    x = [0.01 * k for k in range(3000)]
    chart = LineChart([Curve("u", x, Counted(x)), Curve("v", x, x)], "t [s]", "u [V]")
    (_, path, dots), _ = chart.lines
    assert len(dots) == path.count("L") + 1 == 300
    assert Counted.asked <= 4 * len(x)


def test_a_value_that_a_template_lacks_is_an_error() -> None:
    with pytest.raises(jinja2.UndefinedError):
        pages.page("wakedeploy.study", "study.html", title="t")
