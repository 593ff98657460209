"""What commands print: tables, progress bars, and results as JSON for other programs."""

import contextlib
import json
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

_UNLIMITED_WIDTH = 10_000


class Bar:
    """A progress bar that counts steps; `update` serves as a `(done, total)` callback."""

    def __init__(self, show: Callable[[int, int], None], total: int) -> None:
        self._show, self._done, self._total = show, 0, total

    def advance(self, steps: int = 1) -> None:
        """Count some more steps as done."""
        self.update(self._done + steps, self._total)

    def update(self, done: int, total: int) -> None:
        """Show that `done` of `total` steps are done."""
        self._done, self._total = done, total
        self._show(done, total)


@contextlib.contextmanager
def progress(description: str, total: int) -> Iterator[Bar]:
    """A progress bar on stderr while the block runs; silent when that is not a terminal."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    shown = Progress(console=console, transient=True, disable=not console.is_terminal)
    with shown:
        task = shown.add_task(description, total=total)
        yield Bar(lambda done, of: shown.update(task, completed=done, total=of), total)


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table, the first column to the left and numbers to the right; never cut in a pipe."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console()
    if not console.is_terminal:
        console = Console(width=_UNLIMITED_WIDTH)
    console.print(Text(title, style="bold"))
    table = Table(show_header=any(columns))
    for index, column in enumerate(columns):
        table.add_column(Text(column), justify="left" if index == 0 else _side(rows, index))
    for row in rows:
        table.add_row(*(Text(cell) for cell in row))
    console.print(table)


def write_json(path: Path, result: Any) -> None:
    """Write a result as JSON, whole or not at all; NaN and infinity become null."""
    from wakedeploy.files import write_text_whole

    text = json.dumps(_finite(result), indent=2, allow_nan=False)
    write_text_whole(path, text + "\n")


def _side(rows: Sequence[Sequence[str]], index: int) -> Any:
    """Right for a column of numbers, left for words."""
    cells = [row[index].strip() for row in rows]
    return "right" if all(cell == "" or cell[0] in "-+−.—0123456789" for cell in cells) else "left"


def _finite(value: Any) -> Any:
    """The value with what JSON cannot say as null: NaN, infinities; NumPy numbers as Python's."""
    if isinstance(value, dict):
        return {str(key): _finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(entry) for entry in value]
    if hasattr(value, "tolist"):
        return _finite(value.tolist())
    if isinstance(value, float) and (value != value or value in (float("inf"), float("-inf"))):
        return None
    return str(value) if isinstance(value, Path) else value
