"""The directive `made`: a part of a page that is made of the code whenever the site is built.

    ```{made} commands gap
    ```

The first argument names a module of `parts`, whose `markdown()` returns the part's text. It is
given the other arguments.
"""

import importlib

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective


class Made(SphinxDirective):
    """Puts the Markdown of `parts.NAME.markdown(…)` in its place.

    Its own text is for those who read the page in a checkout: it says where the part is made from.
    """

    required_arguments, optional_arguments = 1, 20
    has_content = True

    def run(self) -> list[nodes.Node]:
        """The nodes of the part, headings included."""
        name, *of = self.arguments
        text = importlib.import_module(f"parts.{name}").markdown(*of)
        return self.parse_text_to_nodes(text, allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, bool]:
    """As Sphinx asks for an extension."""
    app.add_directive("made", Made)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
