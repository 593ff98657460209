"""HTML by plain functions: whatever is not markup already is escaped.

In: text, and markup made here. Out: one page that loads nothing, and runs nothing but what sorts
its tables; its own policy forbids a browser everything else.
"""

import base64
import hashlib
from collections.abc import Sequence
from html import escape
from pathlib import Path

_PHONE_PX = 700  # wider pictures scroll sideways on a phone rather than shrink beyond reading
_VOID = frozenset({"img", "meta"})


class Markup(str):
    """Text that is HTML already; every other text is escaped on its way into an element."""

    __slots__ = ()


def element(name: str, /, *inside: str, **attributes: str) -> Markup:
    """`<name attributes>inside</name>`; `class_` stands for `class`."""
    told = "".join(
        f' {key.rstrip("_").replace("_", "-")}="{escape(value)}"'
        for key, value in attributes.items()
    )
    if name in _VOID:
        return Markup(f"<{name}{told}>")
    return Markup(f"<{name}{told}>{together(*inside)}</{name}>")


def together(*parts: str) -> Markup:
    """Parts one after another, escaped unless they are markup."""
    return Markup("".join(p if isinstance(p, Markup) else escape(p) for p in parts))


def table(columns: Sequence[str], rows: Sequence[Sequence[str]]) -> Markup:
    """A table that scrolls sideways where the screen is narrow; nothing if there are no rows."""
    if not rows:
        return Markup()
    head = element("tr", *(element("th", column, scope="col") for column in columns))
    body = [element("tr", *(element("td", cell) for cell in row)) for row in rows]
    inside = element("table", element("thead", head), element("tbody", *body))
    return element("div", inside, class_="wide")


def picture(path: Path, caption: str) -> Markup:
    """A PNG file, embedded, with its caption, which is also its text for those who cannot see."""
    png = path.read_bytes()
    source = f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"
    width = int.from_bytes(png[16:20], "big")  # the first field of IHDR, a PNG's first chunk
    text = caption.split(". ")[0]
    image = element("img", src=source, alt=text, width=str(width))
    frame = element("div", image, class_="wide" if width > _PHONE_PX else "narrow")
    return element("figure", frame, element("figcaption", caption))


def page(title: str, *body: str) -> Markup:
    """The whole document."""
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=_policy()),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("title", title),
        element("style", Markup(_STYLE)),
    )
    script = element("script", Markup(_SORTING))
    html = element("html", head, element("body", element("main", *body), script), lang="en")
    return Markup(f"<!DOCTYPE html>\n{html}\n")


def _policy() -> str:
    """Nothing from elsewhere, embedded pictures, and the one script by its hash."""
    digest = base64.b64encode(hashlib.sha256(_SORTING.encode()).digest()).decode("ascii")
    return (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; "
        f"script-src 'sha256-{digest}'"
    )


# A click or Enter on a column's head sorts by it, once more the other way; numbers by their size.
_SORTING = """
const size = text => parseFloat(text.replace(/\u2212/g, "-").replace(/,(?=\\d{3})/g, ""));
const order = (a, b) => {
  const x = size(a), y = size(b);
  return isNaN(x) || isNaN(y) ? isNaN(x) - isNaN(y) || a.localeCompare(b) : x - y;
};
const sort = head => {
  const up = head.getAttribute("aria-sort") !== "ascending";
  const column = head.cellIndex, body = head.closest("table").tBodies[0];
  const text = row => row.cells[column] ? row.cells[column].textContent.trim() : "";
  const rows = [...body.rows].sort((a, b) => order(text(a), text(b)) * (up ? 1 : -1));
  for (const other of head.parentNode.cells) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", up ? "ascending" : "descending");
  body.append(...rows);
};
for (const head of document.querySelectorAll("thead th")) {
  head.tabIndex = 0;
  head.addEventListener("click", () => sort(head));
  head.addEventListener("keydown", key => { if (key.key === "Enter") sort(head); });
}
"""

_STYLE = """
:root { color-scheme: light dark; --ink: #1c1c1c; --soft: #5c5c5c; --line: #d8d8d8;
  --ground: #ffffff; --card: #f5f6f7; --accent: #0072b2; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e8e8e8; --soft: #a8a8a8; --line: #3c3f42; --ground: #16181a; --card: #212427;
    --accent: #56b4e9; }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink);
  font: 16px/1.55 system-ui, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
main { max-width: 60rem; margin: 0 auto; padding: 1.5rem 1rem 4rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.25rem; margin: 2.6rem 0 .5rem; padding-top: .7rem;
  border-top: 1px solid var(--line); }
h3 { font-size: 1rem; margin: 1.6rem 0 .3rem; }
p { margin: .5rem 0; max-width: 46rem; }
a { color: var(--accent); }
nav { font-size: .9rem; }
nav a { margin-right: 1rem; }
.soft, figcaption { color: var(--soft); font-size: .9rem; }
.account { background: var(--card); border-left: 4px solid var(--accent); border-radius: 6px;
  padding: .7rem 1.1rem; margin: 1rem 0; }
.account p:first-child { font-size: 1.15rem; font-weight: 600; }
.tiles { display: flex; flex-wrap: wrap; gap: .7rem; margin: 1rem 0; }
.tile { flex: 1 1 9rem; background: var(--card); border-radius: 6px; padding: .6rem .8rem; }
.tile b { display: block; font-size: 1.2rem; line-height: 1.3; overflow-wrap: anywhere; }
.next { border: 1px dashed var(--accent); border-radius: 6px; padding: .5rem 1rem; }
figure { margin: 1.2rem 0; }
img { display: block; max-width: 100%; height: auto; background: #fff; border-radius: 6px;
  border: 1px solid var(--line); }
figcaption { margin-top: .35rem; max-width: 46rem; }
@media screen and (max-width: 640px) { figure .wide img { max-width: none; width: 640px; } }
.wide { overflow-x: auto; margin: .7rem 0; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; vertical-align: top; padding: .28rem .9rem .28rem 0;
  border-bottom: 1px solid var(--line); }
th { color: var(--soft); font-weight: 600; white-space: nowrap; }
thead th[tabindex] { cursor: pointer; }
thead th[aria-sort]::after { content: " \\2191"; }
thead th[aria-sort="descending"]::after { content: " \\2193"; }
code { font-family: ui-monospace, Menlo, Consolas, monospace; font-size: .92em;
  overflow-wrap: anywhere; }
pre { background: var(--card); border-radius: 6px; padding: .7rem 1rem; overflow-x: auto; }
details { margin-top: 1.2rem; }
summary { cursor: pointer; color: var(--accent); }
@media print {
  :root { color-scheme: light; --ink: #000; --soft: #444; --line: #bbb; --ground: #fff;
    --card: #f3f3f3; --accent: #0072b2; }
  body { font-size: 10.5pt; }
  main { max-width: none; padding: 0; }
  nav { display: none; }
  figure, tr, .account, .tile { break-inside: avoid; }
  h2, h3 { break-after: avoid; }
}
"""
