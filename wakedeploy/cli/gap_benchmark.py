"""`wakedeploy gap benchmark`: the workflow against effects that are hidden from it."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.output import progress, write_json
from wakedeploy.cli.workers import workers_option
from wakedeploy.errors import UnusableInput

if TYPE_CHECKING:
    from wakedeploy.gap.benchmark.cases import Case

_FOLDER = click.Path(file_okay=False, path_type=Path)
_FILE = click.Path(dir_okay=False, path_type=Path)
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
@click.option(
    "--page",
    type=_FILE,
    help="Also write the tables as a Markdown page, a figure and the cases beside it.",
)
def benchmark(
    short: bool,
    full: bool,
    only: tuple[str, ...],
    workers: int,
    out: Path,
    table_only: bool,
    keep: bool,
    page: Path | None,
) -> None:
    """Hide effects in two plants, let the workflow close the gap, and judge its answers.

    Some 300 cases, each judged by rules that were fixed before; a few also fly predictors trained
    on the old and the corrected rig file (needs the extra "train"). Resumable: a second run of the
    same committed code does what the first one left. In OUT: cases.jsonl, summary.json,
    benchmark.md, benchmark.png.

    \b
    Example:
        wakedeploy gap benchmark --short
        wakedeploy gap benchmark --workers 2 --page docs/gap-benchmark.md
    """
    from wakedeploy.gap.benchmark.run import read_lines, run_cases

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
    _write(lines, out, page)


def _chosen(short: bool, full: bool, only: tuple[str, ...]) -> "list[Case]":
    from wakedeploy.gap.benchmark.cases import all_cases, short_cases

    cases = short_cases() if short else all_cases(repeats=_MULTIPLES if full else 1)
    chosen = [case for case in cases if not only or case.name.startswith(only)]
    if not chosen:
        raise UnusableInput(f"--only {' '.join(only)}: no case's name begins so.")
    return chosen


def _write(lines: list[dict[str, Any]], out: Path, page: Path | None) -> None:
    from wakedeploy import figures
    from wakedeploy.files import write_text_whole
    from wakedeploy.gap.benchmark.page import draw, markdown_of, text_of
    from wakedeploy.gap.benchmark.run import LINES
    from wakedeploy.gap.benchmark.table import summary

    told = summary(lines)
    write_json(out / "summary.json", told)
    for path in filter(None, (out / "benchmark.md", page)):
        picture = path.with_suffix(".png")
        figures.save(draw(told), picture)
        lines_name = path.with_suffix(".jsonl").name if path == page else LINES
        write_text_whole(path, markdown_of(told, picture.name, lines_name))
    if page:  # what the tables can be made of again, and the run gone on with
        text = "".join(json.dumps(line) + "\n" for line in lines)
        write_text_whole(page.with_suffix(".jsonl"), text)
    click.echo(text_of(told))


command = benchmark
