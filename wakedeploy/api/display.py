"""How results show themselves in a notebook: tables, rows as a DataFrame."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from wakedeploy.core.errors import UnusableInput, installs
from wakedeploy.core.runlog import Array

if TYPE_CHECKING:
    import pandas


def html_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A titled table as HTML; whatever stands in a cell is escaped."""
    from markupsafe import Markup

    from wakedeploy.core.pages import table

    return Markup("<p><strong>{}</strong></p>{}").format(title, table(columns, rows))


def data_frame(
    columns: Mapping[str, Sequence[Any] | Array], index: str | None = None
) -> "pandas.DataFrame":
    """A pandas DataFrame of columns, one of them the index; UnusableInput without pandas."""
    try:
        import pandas
    except ModuleNotFoundError as error:
        raise UnusableInput(f"pandas is not installed; {installs('notebook')}.") from error
    frame = pandas.DataFrame(dict(columns))
    return frame if index is None else frame.set_index(index)
