"""What commands print: tables, how far they are, and results as JSON for other programs."""

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import click

from wakedeploy.cli.log_lines import LogLines, ticking
from wakedeploy.core.errors import UnusableInput, printable, why


class Written(click.Path):
    """A file that a command writes at its end; a place where none can be is refused at once.

    So is a name that does not end in `ending`, where all files are of one kind. A file that the
    command reads is refused before it runs, unless one `may_replace` it.
    """

    def __init__(self, ending: str = "", *, may_replace: bool = False) -> None:
        super().__init__(dir_okay=False, path_type=Path)
        self._ending, self.may_replace = ending, may_replace

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path; minutes of fitting should not end at a folder that nobody may write to."""
        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        folder = path.parent
        try:
            if path.exists() and not path.is_file():  # a device or a pipe
                return path
            if not path.name.lower().endswith(self._ending):
                name = f"{path.stem or path.name}{self._ending}"
                self.fail(
                    f"{path}: give a name that ends in {self._ending}, as {name}.", param, ctx
                )
            folder = next(above for above in path.absolute().parents if above.exists())
            with tempfile.TemporaryFile(dir=folder):
                pass
        except OSError as error:
            self.fail(f"{path}: {folder} cannot be written to ({why(error)}).", param, ctx)
        return path


def require_kept(ctx: click.Context) -> None:
    """UsageError where a command would write over a file that it was given to read."""
    params = [(param, ctx.params.get(param.name or "")) for param in ctx.command.get_params(ctx)]
    kept = [
        (param, path)
        for param, value in params
        if isinstance(param.type, click.Path) and not isinstance(param.type, Written)
        for path in _paths(value)
    ]
    for param, value in params:
        if isinstance(param.type, Written) and not param.type.may_replace:
            for path in _paths(value):
                _require_other(ctx, param, path, kept)


def _paths(value: Any) -> list[Path]:
    """The paths that a parameter was given."""
    values = value if isinstance(value, tuple) else (value,)
    return [Path(os.fsdecode(each)) for each in values if isinstance(each, str | bytes | Path)]


def _require_other(
    ctx: click.Context,
    param: click.Parameter,
    path: Path,
    kept: Sequence[tuple[click.Parameter, Path]],
) -> None:
    for reader, read in kept:
        if path.is_file() and read.is_file() and path.samefile(read):
            name = reader.get_error_hint(ctx)
            why_not = f"{path}: {name} reads this file, and it would be written over; give another."
            raise click.BadParameter(why_not, ctx, param)


json_option = click.option(
    "--json",
    "json_path",
    type=Written(),
    help="Also write as JSON.",
)

_UNLIMITED_WIDTH = 10_000


class Bar:
    """A progress bar that counts steps; `update` serves as a `(done, total)` callback."""

    def __init__(
        self,
        show: Callable[[int, int], None],
        total: int,
        tell: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._show, self._done, self._total, self._tell = show, 0, total, tell

    def describe(self, text: str) -> None:
        """Put another text before the bar."""
        self._tell(text)

    def advance(self, steps: int = 1) -> None:
        """Count some more steps as done."""
        self.update(self._done + steps, self._total)

    def update(self, done: int, total: int) -> None:
        """Show that `done` of `total` steps are done."""
        self._done, self._total = done, total
        self._show(done, total)


@contextlib.contextmanager
def told_when_stopped(sentence: str | Callable[[], str]) -> Iterator[None]:
    """Ctrl-C in the block ends the command with this sentence, which says how to go on."""
    try:
        yield
    except KeyboardInterrupt:
        click.echo(sentence if isinstance(sentence, str) else sentence(), err=True)
        raise click.exceptions.Exit(130) from None


@contextlib.contextmanager
def progress(
    description: str, total: int, done: int = 0, *, counted: bool = False
) -> Iterator[Bar]:
    """A progress bar on stderr while the block runs; lines (`LogLines`) when that is no terminal.

    `done` steps were done before. `counted` shows how many steps of how many are done.
    """
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress

    console = Console(stderr=True)
    if not console.is_terminal:
        lines = LogLines(description, total, done, counted=counted)
        with ticking(lines.tick):
            yield Bar(lines.update, total, lines.describe)
        lines.end()
        return
    columns = [*Progress.get_default_columns(), *([MofNCompleteColumn()] if counted else [])]
    # Steps may take minutes: time left is estimated from all steps, not from the last half minute.
    shown = Progress(
        *columns,
        console=console,
        transient=True,
        speed_estimate_period=86_400.0,
    )
    with shown:
        task = shown.add_task(description, total=total, completed=done)
        yield Bar(
            lambda done, of: shown.update(task, completed=done, total=of),
            total,
            lambda text: shown.update(task, description=text),
        )


class StageBars:
    """A bar for each stage that work reports; serves as its `progress`."""

    def __init__(self, shown: contextlib.ExitStack) -> None:
        self._shown, self._stage, self._bar = shown, "", Bar(lambda done, total: None, 0)

    def __call__(self, stage: str, done: int = 0, total: int = 0, /) -> None:
        """Show a new stage's bar in place of the last one's, or how far the stage is."""
        if stage != self._stage:
            self._shown.close()
            self._stage = stage
            self._bar = self._shown.enter_context(progress(stage, total or 1))
        if total:
            self._bar.update(done, total)

    def describe(self, text: str) -> None:
        """Put another text before the bar of this stage."""
        self._bar.describe(text)


@contextlib.contextmanager
def stage_bars() -> Iterator[StageBars]:
    """Bars on stderr for the stages of the block's work, as `progress` shows one."""
    with contextlib.ExitStack() as shown:
        yield StageBars(shown)


@contextlib.contextmanager
def answered_by_hand(otherwise: str) -> Iterator[None]:
    """What the block asks is answered at a terminal; UnusableInput where the input has ended.

    `otherwise` says what to do without one. Ctrl-C is what it is elsewhere.
    """
    try:
        yield
    except click.Abort as error:
        if isinstance(error.__context__, EOFError):
            click.echo(err=True)  # the question's line has not ended
            raise UnusableInput(
                f"The standard input has ended before an answer; {otherwise}."
            ) from error
        raise


def warn(sentence: str) -> None:
    """What a person should know, as a line on stderr."""
    click.echo(sentence, err=True)


def print_table(title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table, the first column to the left and numbers to the right; never cut in a pipe."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console()
    if not console.is_terminal:
        console = Console(width=_UNLIMITED_WIDTH)
    console.print(Text(printable(title), style="bold"))
    table = Table(show_header=any(columns))
    for index, column in enumerate(columns):
        table.add_column(
            Text(printable(column)), justify="left" if index == 0 else _side(rows, index)
        )
    for row in rows:
        table.add_row(*(Text(printable(cell)) for cell in row))
    console.print(table)


def write_json(path: Path | None, result: Any) -> None:
    """Write a result as JSON if there is a path, whole or not at all; NaN becomes null."""
    from wakedeploy.core.files import json_text, write_text_whole

    if path is not None:
        write_text_whole(path, json_text(result))


def _side(rows: Sequence[Sequence[str]], index: int) -> Any:
    """Right for a column of numbers, left for words."""
    cells = [row[index].strip() for row in rows]
    return "right" if all(cell == "" or cell[0] in "-+−.—0123456789" for cell in cells) else "left"


def what_differs(settings: Mapping[str, object], others: Iterable[Mapping[str, object]]) -> str:
    """The settings in which one of several differs from any other, as `name value, …`."""
    alike = list(others)
    return ", ".join(
        f"{name} {value}"
        for name, value in settings.items()
        if any(other.get(name) != value for other in alike)
    )


def mean_and_spread(values: list[float | None], style: str) -> str:
    """Mean ± sample standard deviation; a dash where a value is not defined."""
    import statistics

    known = [value for value in values if value is not None]
    if not known:
        return "—"
    mean = f"{statistics.mean(known):{style}}"
    return mean if len(known) < 2 else f"{mean} ± {statistics.stdev(known):.2g}"
