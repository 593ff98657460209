"""A report in a browser: a click on a column's head sorts by it, and nothing else may run."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from wakedeploy.core.markup import Markup, element, page, table

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


def with_script(text: str, script: str) -> str:
    return text.replace("</body>", f"<script>{script}</script></body>")


def names(document: str) -> str:
    return "".join(re.findall(r"<tr><td>(\w)</td>", document))


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
@pytest.mark.parametrize(("clicks", "order"), [("", "abcde"), ("x", "cbade"), ("xx", "edabc")])
def test_a_column_is_sorted_by_the_size_of_its_numbers(
    clicks: str, order: str, tmp_path: Path
) -> None:
    text = str(page("t", table(["name", "gain"], ROWS)))
    allowed = re.sub(r"<meta http-equiv[^>]*>", "", text)
    assert names(shown(tmp_path, with_script(allowed, CLICK.format(clicks)))) == order


@pytest.mark.skipif(CHROMIUM is None, reason="chromium is not installed")
def test_no_other_script_runs(tmp_path: Path) -> None:
    text = str(page("t", element("h1", Markup("kept"))))
    document = shown(tmp_path, with_script(text, "document.querySelector('h1').remove()"))
    assert "<h1>kept</h1>" in document
    assert 'tabindex="0"' in shown(tmp_path, str(page("t", table(["name"], [["a"]]))))
