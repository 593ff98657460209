"""HTML by templates: whatever a value says is escaped.

In: a template and values. Out: one page that loads nothing, and runs nothing but the one script of
its own; its policy forbids a browser everything else. The look of every page is in `templates/`
beside this module; what one kind of page shows is in `templates/` beside the module that writes it.
"""

import base64
import functools
import hashlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

HERE = "wakedeploy.core"
_CODE = re.compile(r"`([^`]+)`")
_PHONE_PX = 700  # wider pictures scroll sideways on a phone rather than shrink beyond reading


@dataclass(frozen=True)
class Table:
    """Texts in rows under heads; a reader sorts them by a click on a head."""

    columns: Sequence[str]
    rows: Sequence[Sequence[str]]

    def __bool__(self) -> bool:
        """A table without a row is not shown."""
        return bool(self.rows)


@dataclass(frozen=True)
class Picture:
    """A PNG file to embed, and its caption, which is also its text for those who cannot see."""

    path: Path
    caption: str

    @functools.cached_property
    def _png(self) -> bytes:
        return self.path.read_bytes()

    @property
    def source(self) -> str:
        """The file as an address that holds all of it."""
        return f"data:image/png;base64,{base64.b64encode(self._png).decode('ascii')}"

    @property
    def width(self) -> int:
        """Pixels across: the first field of IHDR, which is a PNG's first chunk."""
        return int.from_bytes(self._png[16:20], "big")

    @property
    def is_wide(self) -> bool:
        """Whether a phone has to scroll."""
        return self.width > _PHONE_PX

    @property
    def alt(self) -> str:
        """The caption's first sentence."""
        return self.caption.split(". ")[0]


def page(package: str, template: str, **values: object) -> str:
    """A whole page by a template that lies in `templates/` of a package.

    Raises jinja2.UndefinedError for a value that the template wants and nobody gave.
    """
    return _environment(package).get_template(template).render(values)


def table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Markup:
    """A table as a piece of HTML, for notebooks; nothing if there are no rows."""
    return _part("table", Table(columns, rows))


def picture(path: Path, caption: str) -> Markup:
    """An embedded picture as a piece of HTML, for notebooks."""
    return _part("picture", Picture(path, caption))


def text_file(name: str) -> str:
    """A file of the common look: `look.css` is also what live pages are coloured by."""
    return (files(HERE) / "templates" / name).read_text("utf-8")


def prose(text: str) -> Markup:
    """A sentence whose `names` are code."""
    return Markup(_CODE.sub(r"<code>\1</code>", str(escape(text))))  # noqa: S704 - escaped first


def unbroken(line: str) -> Markup:
    """A command that breaks between its words alone: a browser also breaks behind a hyphen."""
    return Markup(" ").join(Markup("<span>{}</span>").format(word) for word in line.split(" "))


def _part(macro: str, value: object) -> Markup:
    parts = _environment(HERE).get_template("parts.html").module
    return Markup(getattr(parts, macro)(value))  # noqa: S704 - made by a template that escapes


@functools.cache
def _environment(package: str) -> Environment:
    """Templates of a package, and the common ones."""
    loaders = [PackageLoader(each) for each in dict.fromkeys((package, HERE))]
    environment = Environment(
        loader=ChoiceLoader(loaders),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"prose": prose, "unbroken": unbroken}
    script = text_file("report.js")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode("ascii")
    environment.globals |= {
        "script": Markup(script),  # noqa: S704 - ours
        "style": Markup(text_file("look.css") + text_file("report.css")),  # noqa: S704 - ours
        "policy": "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
        f"script-src 'sha256-{digest}'",
    }
    return environment
