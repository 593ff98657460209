"""Hide effects in two plants, let the workflow close the gap, and judge its answers.

    python -m benchmarks.hidden_effects --short
    python -m benchmarks.hidden_effects --workers 2

Some 300 cases, each judged by rules that were fixed before; a few also fly predictors trained on
the old and the corrected rig file (needs the extra "train"). Resumable: a second run of the same
committed code does what the first one left. In OUT: cases.jsonl, summary.json, benchmark.md,
benchmark.png.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.hidden_effects.cases import Case, all_cases, short_cases
from benchmarks.hidden_effects.lines import LINES, read_lines
from benchmarks.hidden_effects.page import draw, markdown_of, text_of
from benchmarks.hidden_effects.run import run_cases
from benchmarks.hidden_effects.table import summary
from wakedeploy.cli.output import progress, write_json
from wakedeploy.core import figures
from wakedeploy.core.errors import UnusableInput, WakedeployError
from wakedeploy.core.files import write_text_whole
from wakedeploy.core.processes import default_workers

_MULTIPLES = 3


def main(given: Sequence[str] | None = None) -> None:
    """Fly or read cases, then write and print their tables; UnusableInput for impossible wishes."""
    options = _options(given)
    out: Path = options.out
    if options.short and options.full:
        raise UnusableInput("Give --short or --full, not both.")
    cases = _chosen(options.short, options.full, options.only)
    if options.table_only:
        known = {line["name"]: line for line in read_lines(out)}
        lines = [known[case.name] for case in cases if case.name in known]
    else:
        with progress("Hiding and seeking", len(cases)) as bar:
            lines = run_cases(
                cases, out, workers=options.workers, keep=options.keep, progress=bar.update
            )
    if not lines:
        raise UnusableInput(f"{out}: there is no finished case; run without --table-only.")
    _write(lines, out)


def _options(given: Sequence[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.hidden_effects",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--short", action="store_true", help="a handful of cases")
    parser.add_argument("--full", action="store_true", help="more strengths, three times the seeds")
    parser.add_argument(
        "--only", action="append", default=[], help="cases whose name begins so; may be repeated"
    )
    parser.add_argument("--workers", type=int, default=default_workers(), help="processes")
    parser.add_argument("--out", type=Path, default=Path("gap-benchmark"), help="the folder")
    parser.add_argument(
        "--table-only", action="store_true", help="fly nothing: tables of what is there"
    )
    parser.add_argument("--keep", action="store_true", help="keep each case's logs and answer")
    return parser.parse_args(given)


def _chosen(short: bool, full: bool, only: Sequence[str]) -> list[Case]:
    cases = short_cases() if short else all_cases(repeats=_MULTIPLES if full else 1)
    chosen = [case for case in cases if not only or case.name.startswith(tuple(only))]
    if not chosen:
        raise UnusableInput(f"--only {' '.join(only)}: no case's name begins so.")
    return chosen


def _write(lines: list[dict[str, Any]], out: Path) -> None:
    totals, picture = summary(lines), out / "benchmark.png"
    write_json(out / "summary.json", totals)
    figures.save(draw(totals), picture)
    write_text_whole(out / "benchmark.md", markdown_of(totals, picture.name, LINES))
    print(text_of(totals))


if __name__ == "__main__":
    try:
        main()
    except WakedeployError as error:
        print(error, file=sys.stderr)
        sys.exit(error.exit_status)
