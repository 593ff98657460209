"""The pages themselves: links, sizes, files that they show, and words that they do without."""

import re
from pathlib import Path

import pytest
from shell_lines import FENCE, PAGES, ROOT, fences

from wakedeploy.rig.file import default_rig_text, parse_rig

LINK = re.compile(r"(?:\]\(|\bhref=\")([^)#\s\"]*)(?:#([^)\s\"]*))?[)\"]")
MOST_NUMBERS = 5  # of a paragraph


def anchors(page: Path) -> set[str]:
    """The names that a page's headings have as targets of links."""
    headings = re.findall(r"^#+ (.*)$", FENCE.sub("", page.read_text("utf-8")), re.MULTILINE)
    bare = [re.sub(r"[^\w\- ]", "", heading.lower()) for heading in headings]
    return {heading.replace(" ", "-") for heading in bare}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_link_leads_to_a_page_and_a_heading(page: Path) -> None:
    for target, anchor in LINK.findall(page.read_text("utf-8")):
        if re.match(r"\w+:", target):
            continue
        aim = (page.parent / target).resolve() if target else page
        assert aim.exists(), target
        assert not anchor or anchor in anchors(aim), f"{target}#{anchor}"


def test_the_index_has_every_page() -> None:
    index = ROOT / "docs" / "README.md"
    listed = {(index.parent / target).resolve() for target, _ in LINK.findall(index.read_text())}
    first_of_the_site = index.with_name("index.md")
    manual = {page for page in PAGES if page.parent != ROOT} - {index, first_of_the_site}
    assert manual <= listed


def test_the_readme_is_short() -> None:
    text = (ROOT / "README.md").read_text("utf-8")
    assert len(text.splitlines()) <= 150
    assert len(text.encode()) <= 9000


def paragraphs(page: Path) -> list[str]:
    """Prose: neither blocks, tables, headings, comments nor code."""
    text = FENCE.sub("", page.read_text("utf-8"))
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    parts = re.split(r"\n\n|\n(?=\s*(?:- |\d+\. ))", text)
    prose = [part for part in parts if not part.lstrip().startswith(("|", "#", "Records "))]
    return [re.sub(r"`[^`]*`|\]\([^)]*\)", "", part) for part in prose]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_paragraph_has_few_numbers_and_plain_words(page: Path) -> None:
    for part in paragraphs(page):
        numbers = re.findall(r"(?<![\w.])\d[\d.,]*", re.sub(r"^\s*\d+\. ", "", part))
        assert len(numbers) <= MOST_NUMBERS, part
        assert not re.search(r"\b(told|of which|by then)\b", part), part


def test_the_rig_file_that_a_page_shows_is_read() -> None:
    plain, in_units = [
        b for w, _, b, _ in fences(ROOT / "docs" / "reference" / "rig-file.md") if w == "toml"
    ]
    before, _, rest = default_rig_text().partition("[sufferer]")
    source = "[thrust.source]" + rest.partition("[thrust.source]")[2]
    rig = parse_rig(before + plain + source)
    assert rig.sufferer.mass_kg == 0.452
    source, _, rest = source.partition("[thrust.sufferer]")
    rest = "[spool.source]" + rest.partition("[spool.source]")[2]
    converted = parse_rig(f"{before}{in_units}\n{source}{rest}")
    assert converted.sufferer == rig.sufferer
    assert converted.thrust.sufferer.pulse_us == (1000.0, 1300.0, 1600.0, 2000.0)
    assert converted.thrust.sufferer.thrust_n == pytest.approx((0.0, 0.81, 3.24, 9.0), abs=0.01)
    (battery,) = [b for w, _, b, _ in fences(ROOT / "docs" / "how-to" / "rig.md") if w == "toml"]
    lines = "\n".join(line.strip() for line in battery.splitlines())
    assert parse_rig(f"{default_rig_text()}\n{lines}").battery.has_divider
