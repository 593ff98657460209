"""Marks the blocks and tables that need more room than a page's column, for site.css.

In: a page as a tree. Out: the same; blocks of sentences that may be wrapped have the class
`sentences`, tables of long texts, which scroll rather than be squeezed, the class `roomy`. Options
of commands are kept whole where a line breaks.
"""

import re
from collections.abc import Sequence
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx

_FRAME = frozenset("│┃━─")  # a line of a printed table has its place below another
_COMMANDS = re.compile(r'<div class="highlight-(?:sh|console) .*?</pre>', re.DOTALL)
_OPTION = re.compile(r"(?<=[\s>])(--?[a-z][\w-]*)")
_ROOMY = 150  # letters across, a column counted by its mean


def setup(app: Sphinx) -> dict[str, bool]:
    """Called by Sphinx."""
    app.connect("doctree-read", _mark)
    app.connect("html-page-context", _keep_options)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def may_wrap(language: str, text: str) -> bool:
    """Whether it is output, and no table in a frame."""
    return language == "text" and not _FRAME & set(text)


def is_roomy(rows: Sequence[Sequence[str]]) -> bool:
    """Whether a table's columns, each as long as its mean cell, take more than a page's column."""
    columns = zip(*rows, strict=False)
    return sum(sum(map(len, column)) / len(column) for column in columns) > _ROOMY


def options_whole(page: str) -> str:
    """A page whose commands have a mark about each option: a browser breaks behind a hyphen."""
    return _COMMANDS.sub(
        lambda block: _OPTION.sub(r'<span class="whole">\1</span>', block[0]), page
    )


def _keep_options(app: Sphinx, name: str, template: str, context: dict[str, Any], *_: Any) -> None:
    if "body" in context:
        context["body"] = options_whole(context["body"])


def _mark(app: Sphinx, tree: nodes.document) -> None:
    for block in tree.findall(nodes.literal_block):
        if may_wrap(block.get("language", ""), block.astext()):
            block["classes"].append("sentences")
    for table in tree.findall(nodes.table):
        rows = [[cell.astext() for cell in row.children] for row in table.findall(nodes.row)]
        if is_roomy(rows):
            table["classes"].append("roomy")
