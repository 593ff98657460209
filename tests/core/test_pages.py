"""A report in a browser: a click on a column's head sorts by it, and nothing else may run."""

import html
import re
import shutil
import subprocess
from pathlib import Path

import jinja2
import pytest

from wakedeploy.core import pages

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


def test_a_value_that_a_template_lacks_is_an_error() -> None:
    with pytest.raises(jinja2.UndefinedError):
        pages.page("wakedeploy.study", "study.html", title="t")
