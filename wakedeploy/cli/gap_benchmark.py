"""`wakedeploy gap benchmark`: the workflow against effects that are hidden from it."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.output import progress, write_json
from wakedeploy.cli.workers import workers_option
from wakedeploy.errors import UnusableInput

if TYPE_CHECKING:
    from wakedeploy.gap.benchmark.cases import Case

_FOLDER = click.Path(file_okay=False, path_type=Path)
_MULTIPLES = 3


@click.command()
@click.option("--short", is_flag=True, help="A handful of cases.")
@click.option("--full", is_flag=True, help="More strengths, three times the seeds.")
@click.option("--only", multiple=True, help="Only cases whose name begins so; may be repeated.")
@workers_option()
@click.option(
    "--out", type=_FOLDER, default=Path("gap-benchmark"), show_default=True, help="The folder."
)
@click.option("--table-only", is_flag=True, help="Fly nothing: tables of what is there.")
@click.option("--keep", is_flag=True, help="Keep each case's logs and answer.")
def benchmark(
    short: bool,
    full: bool,
    only: tuple[str, ...],
    workers: int,
    out: Path,
    table_only: bool,
    keep: bool,
) -> None:
    """Hide effects in two plants, let the workflow close the gap, and judge its answers.

    Some 300 cases, each judged by rules that were fixed before; a few also fly predictors trained
    on the old and the corrected rig file (needs the extra "train"). Resumable: a second run of the
    same committed code does what the first one left. In OUT: cases.jsonl, summary.json,
    benchmark.md, benchmark.png.

    \b
    Example:
        wakedeploy gap benchmark --short
        wakedeploy gap benchmark --workers 2
    """
    from wakedeploy.gap.benchmark.lines import read_lines
    from wakedeploy.gap.benchmark.run import run_cases

    if short and full:
        raise UnusableInput("Give --short or --full, not both.")
    cases = _chosen(short, full, only)
    if table_only:
        known = {line["name"]: line for line in read_lines(out)}
        lines = [known[case.name] for case in cases if case.name in known]
    else:
        with progress("Hiding and seeking", len(cases)) as bar:
            lines = run_cases(cases, out, workers=workers, keep=keep, progress=bar.update)
    if not lines:
        raise UnusableInput(f"{out}: there is no finished case; run without --table-only.")
    _write(lines, out)


def _chosen(short: bool, full: bool, only: tuple[str, ...]) -> "list[Case]":
    from wakedeploy.gap.benchmark.cases import all_cases, short_cases

    cases = short_cases() if short else all_cases(repeats=_MULTIPLES if full else 1)
    chosen = [case for case in cases if not only or case.name.startswith(only)]
    if not chosen:
        raise UnusableInput(f"--only {' '.join(only)}: no case's name begins so.")
    return chosen


def _write(lines: list[dict[str, Any]], out: Path) -> None:
    from wakedeploy import figures
    from wakedeploy.files import write_text_whole
    from wakedeploy.gap.benchmark.lines import LINES
    from wakedeploy.gap.benchmark.page import draw, markdown_of, text_of
    from wakedeploy.gap.benchmark.table import summary

    told, picture = summary(lines), out / "benchmark.png"
    write_json(out / "summary.json", told)
    figures.save(draw(told), picture)
    write_text_whole(out / "benchmark.md", markdown_of(told, picture.name, LINES))
    click.echo(text_of(told))


command = benchmark
