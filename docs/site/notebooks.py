"""Tutorials as notebooks: the very text of the page, its commands and its Python as cells.

`notebook(path)` makes one without outputs. Building the site puts one beside each of `TUTORIALS`.
Only the site has it, so only there its name in the page becomes a link.
"""

import re
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

TUTORIALS = ("first-predictor", "own-system")
_FILE = re.compile(r"^<!-- file: (\S+) -->\n```\w+\n", re.MULTILINE)
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
    """The notebook of a page as JSON: its cells are the `sh` and `python` blocks, and the files."""
    import jupytext

    text = _FILE.sub(r"```python\n%%writefile \1\n", page.read_text("utf-8"))
    book = jupytext.reads(_KERNEL + text, fmt="md")
    return str(jupytext.writes(book, fmt="ipynb"))


def _write(app: Sphinx, error: Any) -> None:
    if error is None and app.builder.format == "html":
        for name in TUTORIALS:
            page = Path(app.srcdir) / "tutorials" / f"{name}.md"
            (Path(app.outdir) / "tutorials" / f"{name}.ipynb").write_text(notebook(page), "utf-8")


def linked(text: str, name: str) -> str:
    """The text of a tutorial with a link to its notebook. ValueError where the page names none."""
    file = f"{name}.ipynb"
    if text.count(f"`{file}`") != 1:
        raise ValueError(f"{name}.md: does not name its notebook, `{file}`, once.")
    return text.replace(f"`{file}`", f'<a href="{file}" download>{file}</a>')


def _link(app: Sphinx, page: str, source: list[str]) -> None:
    folder, _, name = page.rpartition("/")
    if app.builder.format == "html" and folder == "tutorials" and name in TUTORIALS:
        source[0] = linked(source[0], name)


def setup(app: Sphinx) -> dict[str, bool]:
    """As Sphinx asks for an extension."""
    app.connect("source-read", _link, priority=600)  # after `neighbours` has read the page
    app.connect("build-finished", _write)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
