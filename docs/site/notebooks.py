"""Tutorials as notebooks: the very text of the page, its commands and its Python as cells.

`notebook(path)` makes one without outputs. Building the site puts one beside each of `TUTORIALS`.
"""

from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

TUTORIALS = ("first-predictor",)
# Without it the language of most blocks would be the notebook's own.
_KERNEL = """---
jupyter:
  kernelspec:
    name: python3
    display_name: Python 3
    language: python
---

"""


def notebook(page: Path) -> str:
    """The notebook of a page as JSON: `sh` and `python` blocks are its cells."""
    import jupytext

    book = jupytext.reads(_KERNEL + page.read_text("utf-8"), fmt="md")
    return str(jupytext.writes(book, fmt="ipynb"))


def _write(app: Sphinx, error: Any) -> None:
    if error is None and app.builder.format == "html":
        for name in TUTORIALS:
            page = Path(app.srcdir) / "tutorials" / f"{name}.md"
            (Path(app.outdir) / "tutorials" / f"{name}.ipynb").write_text(notebook(page), "utf-8")


def setup(app: Sphinx) -> dict[str, bool]:
    """As Sphinx asks for an extension."""
    app.connect("build-finished", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
