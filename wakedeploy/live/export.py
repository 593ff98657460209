"""Flights as one HTML file that needs nothing else: for a colleague, for a paper's supplement."""

import json
import re
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

from markupsafe import Markup

from wakedeploy.core import pages

_MODULES = ("charts.js", "timeline.js", "view.js")
_MODULE_LINES = re.compile(
    r"^import .*;\n|^export (?=(?:default |class |function |const ))", re.MULTILINE
)
_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"


def page_of(flights: Sequence[dict[str, Any]]) -> str:
    """A page with these flights (`flight_data`), drawn over one another; it loads nothing."""
    data = json.dumps(list(flights), separators=(",", ":")).replace("<", "\\u003c")
    style = "".join(_text(name) for name in ("uPlot.min.css", "base.css", "view.css"))
    code = "".join(_MODULE_LINES.sub("", _text(name)) for name in _MODULES)
    # Ours but for the flights, of which no character ends a script.
    return pages.page(
        "wakedeploy.live",
        "export.html",
        title=" and ".join(str(flight["name"]) for flight in flights),
        policy=_POLICY,
        style=Markup(pages.text_file("look.css") + style),  # noqa: S704
        licence=_text("uPlot.licence.txt").replace("--", "––"),
        library=Markup(_text("uPlot.iife.min.js")),  # noqa: S704
        code=Markup(code),  # noqa: S704
        flights=Markup(data),  # noqa: S704
    )


def _text(name: str) -> str:
    return (files("wakedeploy.live") / "static" / name).read_text("utf-8")
