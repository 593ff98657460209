"""Keep what a `wakedeploy` command wrote as records, with day, commit and machine.

    python -m benchmarks.keep table runs.json training      # a table of `train --json`
    python -m benchmarks.keep demo demo                     # a folder of `demo`, picture too
    python -m benchmarks.keep study study/shift             # a study's folder
    python -m benchmarks.keep faults faults.json faults-earlier   # counts of `benchmarks.faults`
    python -m benchmarks.keep gap-demo gap-demo             # folders of `gap demo`,
    python -m benchmarks.keep gap-domain runs/motor         # and `gap domain`
    python -m benchmarks.keep gap-benchmark gap-benchmark   # what `benchmarks.hidden_effects` wrote

The day is the one on which the command wrote its result, on this machine. The commit is the one
that the result states, else the present one. Of a study's tables and pictures those are kept that
pages show. What a recording itself contains is left out: records hold results.
"""

import argparse
import datetime
import json
import shutil
from pathlib import Path
from typing import Any

from benchmarks import records
from benchmarks.hidden_effects.cases import all_cases
from wakedeploy.core.files import write_text_whole

_RUN_PARTS = 4  # runs/gantry/gru/s0
COUNTS = ("fault", "group", "survivable", "flights", "unsafe", "unsafe_above_1_5_mps")


def main() -> None:
    """Read, stamp, write."""
    options = vars(_options())
    KINDS[options.pop("kind")](**options)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    kinds = parser.add_subparsers(dest="kind", required=True)
    for kind in KINDS:
        subparser = kinds.add_parser(kind)
        subparser.add_argument("source", type=Path)
        if kind in ("table", "faults"):
            subparser.add_argument("name", help="the record's name")
    return parser.parse_args()


def table(source: Path, name: str) -> None:
    """A table that a command wrote by `--json`; runs are named as from the working folder."""
    result = _read(source)
    for row in result.get("rows", []):
        if "run" in row and Path(row["run"]).is_absolute():
            row["run"] = str(Path(*Path(row["run"]).parts[-_RUN_PARTS:]))
    _write(name, source, result)


def demo(source: Path) -> None:
    """The demo's result and its picture, which are of the same flights."""
    _keep("demo", source / "result.json")
    shutil.copyfile(source / "demo.png", records.FIGURES / "demo.png")


def study(source: Path) -> None:
    """A study's result, and those of its tables and pictures that are kept already."""
    _keep(f"study-{source.name}", source / "study.json")
    for kind, folder in (("csv", records.FOLDER), ("png", records.FIGURES)):
        for path in source.glob(f"*.{kind}"):
            target = folder / f"study-{path.name}"
            if target.exists():
                shutil.copyfile(path, target)


def faults(source: Path, name: str) -> None:
    """A campaign's counts without its flights: of an earlier loop no more is shown."""
    result = _read(source)
    for plant in ("exact", "mismatched"):
        rows = result[plant]["faults"]
        result[plant] = {"faults": [{key: row[key] for key in COUNTS} for row in rows]}
    result.pop("unsafe_flights", None)  # the head of the table of flights
    _write(name, source, result)


def gap_demo(source: Path) -> None:
    """The demo's own account, its result and what the predictors are worth on measured flights."""
    result = {
        "demo": _read(source / "demo.json"),
        "result": _read(source / "gap" / "result.json"),
        "retrain": _read(source / "gap" / "show.json")["retrain"],
    }
    _write("gap-demo", source / "demo.json", result)
    shutil.copyfile(source / "gap-demo-story.png", records.FIGURES / "gap-demo-story.png")


def gap_domain(source: Path) -> None:
    """A domain's result without what only its page draws, recordings among it."""
    result = _read(source / "domain.json")
    for part in (result, *(nested for nested in result.values() if isinstance(nested, dict))):
        for name in ("shown", "where"):
            part.pop(name, None)
    _write(f"gap-domain-{result['domain']}", source / "domain.json", result)


def gap_benchmark(source: Path) -> None:
    """The benchmark's lines, one for each case; each states its commit already.

    All cases take hours of a core. Lines of cases that this run has not done yet stay, with the day
    and the commit that they state, as long as there are such cases.
    """
    path, kept = source / "cases.jsonl", records.FOLDER / "gap-benchmark.jsonl"
    planned = {case.name for case in all_cases(repeats=1)}
    lines = {line["name"]: line for line in _lines(kept) if line["name"] in planned}
    lines |= {line["name"]: {"measured": _day(path)} | line for line in _lines(path)}
    write_text_whole(kept, "".join(json.dumps(line) + "\n" for line in lines.values()))


def _lines(path: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in path.read_text("utf-8").splitlines()]


def _keep(name: str, source: Path) -> None:
    _write(name, source, _read(source))


def _write(name: str, source: Path, result: dict[str, Any]) -> None:
    if "measured" not in result:
        result = {"measured": _day(source), "machine": records.machine()} | result
    records.write(records.FOLDER / f"{name}.json", result)


def _day(source: Path) -> str:
    """When a command wrote a file."""
    return f"{datetime.datetime.fromtimestamp(source.stat().st_mtime, datetime.UTC):%Y-%m-%d}"


def _read(path: Path) -> dict[str, Any]:
    result: dict[str, Any] = json.loads(path.read_text("utf-8"))
    return result


KINDS = {
    "table": table,
    "demo": demo,
    "study": study,
    "faults": faults,
    "gap-demo": gap_demo,
    "gap-domain": gap_domain,
    "gap-benchmark": gap_benchmark,
}

if __name__ == "__main__":
    main()
