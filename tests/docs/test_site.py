"""The built site: it asks no network, its search knows the words, its reference is whole."""

import functools
import importlib.util
import json
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType
from typing import Any

import click
import pytest
from every_command import EVERY
from shell_lines import ROOT

import wakedeploy
from wakedeploy.cli import main
from wakedeploy.core.failsafes import HINTS
from wakedeploy.core.runlog_columns import COLUMNS
from wakedeploy.core.runlog_meanings import MEANINGS
from wakedeploy.gap.systems.kinds.library import KINDS_BY_ROLE

SITE = ROOT / "build" / "docs" / "html"
built = pytest.mark.skipif(not (SITE / "index.html").exists(), reason="make docs builds the site")


def extension(name: str) -> ModuleType:
    """One of the site's own, which are no modules of a package."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "docs" / "site" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Loaded(HTMLParser):
    """Addresses that a browser fetches by itself when it shows a page."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        told = dict(attrs)
        relation = (told.get("rel") or "").split()
        if tag in ("script", "img", "iframe", "source", "video", "audio"):
            self.found.append(told.get("src") or "")
        if tag == "link" and {"stylesheet", "icon", "preload", "preconnect"} & {*relation}:
            self.found.append(told.get("href") or "")


@built
def test_no_page_loads_anything_from_elsewhere() -> None:
    for page in SITE.rglob("*.html"):
        loaded = Loaded()
        loaded.feed(page.read_text("utf-8"))
        assert not [url for url in loaded.found if re.match(r"(\w+:)?//", url)], page
    for sheet in SITE.rglob("*.css"):
        fetched = re.findall(r"(?:url\(|@import)\s*['\"]?(?:https?:)?//", sheet.read_text("utf-8"))
        assert not fetched, sheet


@functools.cache
def index() -> dict[str, Any]:
    """What the site's search looks in."""
    text = (SITE / "searchindex.js").read_text("utf-8")
    return json.loads(text.removeprefix("Search.setIndex(").removesuffix(")"))


@built
def test_the_search_knows_the_words_of_the_pages_offline() -> None:
    for word, page in {"deadman": "reference/endings", "placebo": "how-to/gap-report"}.items():
        found = index()["terms"][word]
        numbers = [found] if isinstance(found, int) else found
        assert page in {index()["docnames"][number] for number in numbers}, word


COMMANDS = sorted((ROOT / "docs" / "reference" / "commands").glob("*.md"))


def test_each_command_stands_on_one_page_of_the_reference() -> None:
    named = [
        name
        for page in COMMANDS
        for made in re.findall(r"```\{made\} commands (.*)", page.read_text("utf-8"))
        for name in made.split()
    ]
    assert sorted(named) == sorted(main.list_commands(click.Context(main)))


@built
def test_the_search_finds_every_command_by_its_heading() -> None:
    for name in map(" ".join, EVERY):
        pages = {index()["docnames"][number] for number, _ in index()["alltitles"].get(name, [])}
        assert any(page.startswith("reference/commands/") for page in pages), name


@built
def test_the_reference_has_every_command_name_fault_and_column() -> None:
    def text(page: str) -> str:
        return re.sub(r"<[^>]+>", "", (SITE / "reference" / page).read_text("utf-8"))

    context = click.Context(main, info_name="wakedeploy")
    commands = " ".join(text(f"commands/{page.stem}.html") for page in COMMANDS)
    for name in main.list_commands(context):
        command = main.get_command(context, name)
        options = [o.opts[0] for o in command.params if isinstance(o, click.Option)]
        assert all(option in commands for option in options), name
    python = (SITE / "reference" / "python.html").read_text("utf-8")
    public = {*wakedeploy.__all__} - {"__version__"}
    assert {name for name in public if f'id="wakedeploy.{name}"' not in python} == set()
    assert set(HINTS) <= {*re.findall(r"\w+", text("endings.html"))}
    assert {one.name for one in COLUMNS} <= {*re.findall(r"\w+", text("run-log.html"))}


def test_every_column_of_a_log_has_a_meaning() -> None:
    assert [*MEANINGS] == [one.name for one in COLUMNS]


def test_every_field_of_a_package_has_a_meaning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [str(ROOT / "docs" / "site"), *sys.path])
    manifest = importlib.import_module("parts.manifest")
    assert {*manifest.Manifest.model_json_schema()["properties"]} == {*manifest.MEANINGS}


def test_sentences_are_wrapped_and_printed_tables_are_not() -> None:
    room = extension("room")
    assert room.may_wrap("text", "The system lacks dry friction.")
    assert not room.may_wrap("text", "┏━━┓\n┃ a ┃")
    assert not room.may_wrap("python", "a = 1")


def test_an_option_of_a_command_is_kept_whole() -> None:
    page = '<div class="highlight-sh x"><pre>a --write-it b\n</pre></div> --other'
    whole = extension("room").options_whole(page)
    assert whole == page.replace("--write-it", '<span class="whole">--write-it</span>')


def test_a_table_of_long_texts_scrolls_and_one_of_numbers_does_not() -> None:
    room = extension("room")
    assert room.is_roomy([["x" * 50] * 4] * 3)
    assert not room.is_roomy([["12.5 mm"] * 9] * 3)


def test_the_first_page_has_the_tutorials_in_the_order_of_the_sidebar() -> None:
    text = (ROOT / "docs" / "index.md").read_text("utf-8")
    cards, _, trees = text.partition(":::{toctree}")
    named = re.findall(r":link: (tutorials/[\w-]+)", cards)
    assert named == re.findall(r"^tutorials/[\w-]+", trees, re.MULTILINE)
    assert all(f"{{grid-item-card}} {name}" in cards for name in ("How to", "Results"))


@built
def test_figures_are_dark_where_the_page_is() -> None:
    sheet = (SITE / "_static" / "site.css").read_text("utf-8")
    assert 'data-theme="dark"] .content img' in sheet
    assert "prefers-color-scheme: dark" in sheet


def test_every_constant_of_a_rig_file_has_a_description(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [str(ROOT / "docs" / "site"), *sys.path])
    rows = importlib.import_module("parts.rig_constants").markdown().splitlines()
    cells = [[c.strip() for c in row.strip("|").split("|")] for row in rows if row[:3] == "| `"]
    assert len(cells) > 50
    assert [row[0] for row in cells if len(row) != 5 or len(row[-1].split()) < 3] == []


def test_every_effect_of_a_system_is_told_with_what_it_needs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "path", [str(ROOT / "docs" / "site"), *sys.path])
    rows = importlib.import_module("parts.system_effects").markdown().splitlines()
    of_effects = (row.strip("|") for row in rows if row[:3] == "| `")
    cells = [[c.strip() for c in re.split(r"(?<!\\)\|", row)] for row in of_effects]
    told = [row[0].strip("`") for row in cells]
    assert told == [kind.name for kinds in KINDS_BY_ROLE.values() for kind in kinds]
    assert [row[0] for row in cells if len(row) != 6 or len(row[1].split()) < 2] == []
    loss = [row for row in cells if "*loss*" in row[3]]
    assert [row[0] for row in loss] == ["`upper-stop`", "`lower-stop`"]
    assert all("`position`'s speed" in row[4] for row in loss)


def test_a_link_out_of_the_manual_leads_to_the_page_that_stands_for_it(tmp_path: Path) -> None:
    neighbours = extension("neighbours")
    page = ROOT / "docs" / "development" / "architecture.md"
    known = {ROOT / "CONTRIBUTING.md": page.with_name("contributing.md")}
    text = "[steps](CONTRIBUTING.md#checks), [licence](LICENSE), [records](docs/records/)"
    told = neighbours.relinked(text, ROOT / "ARCHITECTURE.md", page, known)
    assert told == "[steps](contributing.md#checks), licence, records"


@pytest.mark.parametrize("name", extension("notebooks").TUTORIALS)
def test_a_tutorial_names_its_notebook_and_the_site_links_it(name: str) -> None:
    text = (ROOT / "docs" / "tutorials" / f"{name}.md").read_text("utf-8")
    assert f'<a href="{name}.ipynb" download>' in extension("notebooks").linked(text, name)
    assert "href=" not in text  # the checkout has no such file


@built
def test_every_notebook_that_the_site_links_is_there() -> None:
    pages = [SITE / "tutorials" / f"{name}.html" for name in extension("notebooks").TUTORIALS]
    for page in pages:
        found = re.findall(r'href="([^"]+\.ipynb)"', page.read_text("utf-8"))
        assert found == [f"{page.stem}.ipynb"]
        assert (page.parent / found[0]).is_file()
