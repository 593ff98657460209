"""Pages that lie outside docs/ and belong to the site, and links that lead out of it.

A page of the site may stand for a file elsewhere in the repository, such as ARCHITECTURE.md: it
then says "[FILE](FILE) stands here on the site." and nothing else. Links to that file lead to the
page. A link to a folder, or to another file outside docs/, becomes its bare text: the site does
not have it.
"""

import os
import re
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

LINK = re.compile(r"(?<!!)\[(?P<text>[^\]\[]+)\]\((?P<path>[^)#\s:]+)(?P<anchor>#[^)\s]*)?\)")
STANDS_FOR = re.compile(r"# .*\n\n\[.*\]\((?P<path>.*)\) stands here on the site\.\n")
DOCS = Path(__file__).parents[1]


def original(page: Path) -> Path:
    """The file whose text a page shows: itself, or one elsewhere."""
    found = STANDS_FOR.fullmatch(page.read_text("utf-8"))
    return (page.parent / found["path"]).resolve() if found else page


def pages(environment: BuildEnvironment) -> dict[Path, Path]:
    """Each page of the site by the file that holds its text."""
    paths = (Path(environment.doc2path(name)) for name in environment.found_docs)
    return {original(path): path for path in paths}


def relinked(text: str, origin: Path, page: Path, known: dict[Path, Path]) -> str:
    """The text of a file with each link as the site has it; `page` is where it is shown."""

    def instead(link: re.Match[str]) -> str:
        aim = (origin.parent / link["path"]).resolve()
        if aim in known:
            path = os.path.relpath(known[aim], page.parent)
            return f"[{link['text']}]({path}{link['anchor'] or ''})"
        is_there = aim.is_file() and aim.is_relative_to(DOCS)
        return link[0] if is_there else link["text"]

    return LINK.sub(instead, text)


def _read(app: Sphinx, name: str, source: list[str]) -> None:
    page = Path(app.env.doc2path(name))
    origin = original(page)
    source[0] = relinked(origin.read_text("utf-8"), origin, page, pages(app.env))
    app.env.note_dependency(str(origin))


def setup(app: Sphinx) -> dict[str, bool]:
    """As Sphinx asks for an extension."""
    app.connect("source-read", _read)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
