"""Flights as one HTML file that needs nothing else: for a colleague, for a paper's supplement."""

import json
import re
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from typing import Any

_MODULES = ("charts.js", "timeline.js", "view.js")
_MODULE_LINES = re.compile(
    r"^import .*;\n|^export (?=(?:default |class |function |const ))", re.MULTILINE
)
_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"


def page_of(flights: Sequence[dict[str, Any]]) -> str:
    """A page with these flights (`flight_data`), drawn over one another; it loads nothing."""
    title = " and ".join(str(flight["name"]) for flight in flights)
    data = json.dumps(list(flights), separators=(",", ":")).replace("<", "\\u003c")
    style = "".join(_text(name) for name in ("uPlot.min.css", "base.css", "view.css"))
    code = "".join(_MODULE_LINES.sub("", _text(name)) for name in _MODULES)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{style}</style></head>"
        f'<body class="is-export"><main><h1>{escape(title)}</h1><div id="view"></div></main>'
        f"<!-- uPlot: {_licence()} --><script>{_text('uPlot.iife.min.js')}</script>"
        f'<script>"use strict";{code}\n'
        f'new FlightView(document.getElementById("view")).show({data});</script></body></html>\n'
    )


def _licence() -> str:
    return escape(_text("uPlot.licence.txt").replace("--", "––"))


def _text(name: str) -> str:
    return (files("wakedeploy.live") / "static" / name).read_text("utf-8")
