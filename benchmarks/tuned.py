"""Tunes each architecture on each domain, ships what was found, and scores it on the test split.

SETS has one set per domain, made as in the README's session; WORK gets the studies and runs. For
each pair: `wakedeploy tune`, begun at the paper's shape and at what ships so far, its `best.toml`
to `trainers/presets/`, and `wakedeploy train` with that preset and with the reference, three seeds
each, none of which the study has seen, both by the same commit; with a reservoir's other scales,
too. What ships is the best of these on validation with those seeds: a study judges each trial by
one seed, so that its best is in part the luckiest. Goes on where it was stopped; what is named
neither by `--domain` nor by `--arch` keeps its row.

    OMP_NUM_THREADS=1 python -m benchmarks.tuned sets work --jobs 2

Writes docs/records/tuned.json; `make results` makes the page and the figures of it.
"""

import argparse
import datetime
import hashlib
import json
import math
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks import records
from trainers.build import ARCHITECTURES
from trainers.preset import SHIPPED, Preset, read_preset, write_preset
from trainers.training.runs import METRICS
from wakedeploy.core import figures
from wakedeploy.study.domains import MAIN

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# How many trials each has at least: sets of more samples at higher rates take longer for one.
TRIALS = {"fish": 60, "quadrotor": 30, "gantry": 30, "ship": 20, "crazyflie": 20, "downwash": 20}
RESERVOIRS = 60  # trials of a reservoir, which is solved in a second
# Small updates take most of the time and gain little: what they are begins near the reference.
COARSE = {"gru": ("lanes=16:64", "chunk_steps=64:256"), "esn": ()}
COARSE |= {"tcn": COARSE["gru"], "mamba": COARSE["gru"]}
WINDOWS = ("batch=128:1024",)
# What would take most of the time in 100 Hz sets, kept to smaller shapes.
NARROWED = {
    ("downwash", "cross-attention"): ("embed=8:48",),
    ("downwash", "mamba"): ("d_state=2:16",),
}
SEEDS = 3
RECORD = records.FOLDER / "tuned.json"
Row = dict[str, Any]
KEPT = {"tuned": "", "reference": "; the paper's shape ships", "start": "; the other start ships"}


def main() -> None:
    """Tune, ship, score, write; each finished pair at once."""
    options = _options()
    rows = read_rows(RECORD)
    pairs = [(domain, arch) for domain in options.domain for arch in options.arch]
    with ThreadPoolExecutor(options.jobs) as pool:
        under_way = {pool.submit(obtained, *pair, options, records.COMMIT): pair for pair in pairs}
        try:
            for done in as_completed(under_way):
                pair = under_way[done]
                rows[pair] = done.result()
                write(rows)
                print(f"{pair[1]} on {pair[0]}: {gain_text(rows[pair])}", flush=True)
        except BaseException:  # a failure ends it all: its cause is most likely theirs, too
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def obtained(domain: str, arch: str, options: argparse.Namespace, commit: str) -> Row:
    """One pair's row: tuned, scored with and without what was found, and shipped."""
    data, folder = options.sets / domain, options.work / domain / arch
    study_path = folder / "tune.json"
    narrowed = [*COARSE.get(arch, WINDOWS), *NARROWED.get((domain, arch), ())]
    asked = [f"--dimension={text}" for text in narrowed]
    ships = SHIPPED / domain / f"{arch}.toml"
    asked += [f"--start={ships}"] if ships.exists() else []
    trials = options.trials or (RESERVOIRS if arch == "esn" else TRIALS[domain])
    asked += ["--arch", arch, "--data", data, "--trials", trials]
    asked += [] if arch == "esn" else ["--pruner", "hyperband"]  # a reservoir has no epochs
    wakedeploy("tune", *asked, "--out", folder / "study", "--json", study_path)
    best = folder / "study" / "best.toml"
    study = json.loads(study_path.read_text())
    row: Row = {"domain": domain, "arch": arch, "trials": study["trials"]}
    row |= {key: study[key] for key in ("data_sha256", "lead_s", "importances")}
    row |= {"narrowed": narrowed, "found_reference": study["best"]["reference"]}
    row |= {"commit": commit, "date": f"{datetime.date.today():%Y-%m-%d}"}
    row |= {"machine": platform.machine()}
    # A study that went on may have found better, and other code may train otherwise.
    found = f"tuned-{hashlib.sha256(best.read_bytes()).hexdigest()[:8]}"
    runs = folder / commit
    row["reference"] = trained(domain, arch, data, runs / "reference")
    row["tuned"] = trained(domain, arch, data, runs / found, "--preset", best)
    row["starts"] = []
    for number, changes in enumerate(ARCHITECTURES[arch].starts):
        told_apart = [f"--hyper={arch}.{name}={value}" for name, value in changes.items()]
        scores = trained(domain, arch, data, runs / f"start-{number}", *told_apart)
        label = ", ".join(f"{name}={value:g}" for name, value in changes.items())
        row["starts"].append(
            {"label": f"at {label}", "hyper": dict(changes), "settings": {}} | scores
        )
    if confirmed(row) == "reference" and ships.exists():
        row["starts"] += shipped_before(domain, arch, data, ships, runs)
    row["ships"] = confirmed(row)
    ship(row, best, ships)
    return row


def shipped_before(domain: str, arch: str, data: Path, ships: Path, runs: Path) -> list[Row]:
    """What an earlier study found and seeds confirmed, which one lucky trial should not replace."""
    before = read_preset(ships)
    if not before.hyper:
        return []
    kept = runs / f"before-{hashlib.sha256(ships.read_bytes()).hexdigest()[:8]}"
    scores = trained(domain, arch, data, kept, "--preset", ships)
    start = {"label": "as shipped before", "hyper": before.hyper, "settings": before.settings}
    kept_before = "ships" in before.study  # then that study found nothing better
    found_by = before.study.get("found_by") if kept_before else before.study
    return [start | scores | ({"found_by": found_by} if found_by else {})]


def trained(domain: str, arch: str, data: Path, out: Path, *how: object) -> Row:
    """The scores of three seeds, trained as `how` says, else as the paper's shape."""
    scores = out.with_suffix(".json")
    asked = ("--arch", arch, "--data", data, "--seeds", SEEDS, "--out", out, "--json", scores)
    wakedeploy("train", *asked, *how)
    return scored(domain, json.loads(scores.read_text())["rows"])


def confirmed(row: Row) -> str:
    """What errs least on validation, mean over the seeds: reference, tuned, or start (`_start`)."""
    rivals = {"reference": row["reference"], "tuned": row["tuned"]}
    if row["found_reference"]:  # what differs between the two is rounding
        del rivals["tuned"]
    if row["starts"]:
        rivals["start"] = _start(row)
    return min(rivals, key=lambda name: math.fsum(rivals[name]["validation"]))


def _start(row: Row) -> Row:
    """The best on validation of what was tried beside the paper's shape."""
    best: Row = min(row["starts"], key=lambda start: math.fsum(start["validation"]))
    return best


def ship(row: Row, best: Path, path: Path) -> None:
    """Write what ships: what the study found, another scale, or the paper's shape as it is."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if row["ships"] == "tuned":
        shutil.copyfile(best, path)
        return
    found = read_preset(best)
    of_the_found = {"trial", "validation_error", "trainable"}
    found_study = {f"found_{n}" if n in of_the_found else n: v for n, v in found.study.items()}
    kept = _start(row) if row["ships"] == "start" else {"hyper": {}, "settings": {}}
    study = found_study | {"ships": row["ships"]}
    if "found_by" in kept:
        study["found_by"] = kept["found_by"]
    shape = kept["label"].capitalize() if kept["hyper"] else "The paper's shape"
    heading = f"{shape}: with three seeds, what the study found was no better on validation."
    changed = {name: kept[name] for name in ("hyper", "settings")}
    write_preset(path, Preset(arch=found.arch, study=study, **changed), heading)


def wakedeploy(*arguments: object) -> None:
    """A command in a process of its own; SystemExit with what it said where it fails."""
    ended = subprocess.run(
        [sys.executable, "-m", "wakedeploy", *map(str, arguments)], capture_output=True, text=True
    )
    if ended.returncode != 0:
        sys.exit(f"wakedeploy {' '.join(map(str, arguments))}\n{ended.stderr}")


def scored(domain: str, runs: Sequence[Mapping[str, Any]]) -> Row:
    """Test errors of the seeds on the reported channels, as shares of the spread."""
    return {
        "errors": [error(domain, run["r2"]) for run in runs],
        "validation": [validation_error(Path(run["run"])) for run in runs],
        "rmse": [run["rmse"] for run in runs],
        "trainable": runs[0]["trainable"],
        "device": runs[0]["device"],
    }


def validation_error(run: Path) -> float:
    """Root of a run's least validation loss: 1 for predicting the mean."""
    history: list[float] = json.loads((run / METRICS).read_text())["history"]
    return math.sqrt(min(history))


def error(domain: str, r2: Mapping[str, float | None]) -> float:
    """RMSE over standard deviation: 1 for predicting the mean."""
    channels = [MAIN[domain]] if MAIN.get(domain) in r2 else list(r2)
    shares = [1.0 - value for name in channels if (value := r2[name]) is not None]
    return math.sqrt(sum(shares) / len(shares))


def ratio(row: Row) -> tuple[float, float, float]:
    """Tuned over reference: the mean's ratio, and the least and largest of any two seeds."""
    ours, paper = row["tuned"]["errors"], row["reference"]["errors"]
    return sum(ours) / sum(paper), min(ours) / max(paper), max(ours) / min(paper)


def gain_text(row: Row) -> str:
    """A row in words, with what the seeds' scatter leaves open."""
    middle, low, high = ratio(row)
    sure = "" if low > 1.0 or high < 1.0 else " (seeds overlap)"
    kept = KEPT[row["ships"]]
    return f"error × {middle:.2f} [{low:.2f}, {high:.2f}]{sure}{kept}"


def read_rows(path: Path) -> dict[tuple[str, str], Row]:
    """The rows of earlier runs."""
    if not path.exists():
        return {}
    return {(row["domain"], row["arch"]): row for row in json.loads(path.read_text())["rows"]}


def write(rows: Mapping[tuple[str, str], Row]) -> None:
    """The record of all rows, each of which has its own day and commit."""
    ordered = [rows[d, a] for d in TRIALS for a in ARCHITECTURES if (d, a) in rows]
    stamp = {"measured": max(row["date"] for row in ordered)}
    stamp |= {"commit": ", ".join(sorted({row["commit"] for row in ordered}))}
    records.write(RECORD, stamp | {"rows": ordered})


def page(rows: Sequence[Row]) -> str:
    """The tables, a domain each, under sentences made of their numbers."""
    shipped = [row for row in rows if row["ships"] == "tuned"]
    surely = sum(ratio(row)[2] < 1.0 for row in shipped)
    worse = [row for row in shipped if ratio(row)[0] > 1.0]
    devices = {row[name]["device"] for row in rows for name in ("reference", "tuned")}
    parts = [
        "# What tuning gains",
        "`python -m benchmarks.tuned SETS WORK` makes the record of this page. A study starts at "
        "the paper's shape, at the shape that ships and, for a reservoir, at two other scales. One "
        "seed judges each trial on validation. Three other seeds then train the found shape and "
        "the paper's shape, and both are scored on the test split.",
        "The error is the RMSE over the standard deviation; 1 is predicting the mean. Brackets "
        "hold the least and the largest ratio of any tuned seed to any seed of the reference. "
        "Later trials are drawn where earlier ones did well. Hyperband ends trials early that "
        f"fall behind. Trained on: {', '.join(sorted(devices))}.",
        f"The found shape ships for {len(shipped)} of {len(rows)} pairs: it was better on "
        "validation with the three seeds, too. The other pairs ship the paper's shape, a "
        "reservoir's best scale, or what shipped before. On test, every tuned seed beats every "
        f"reference seed in {surely} of the {len(shipped)}.",
        _worse(worse),
        "![Tuned error over the reference's; hollow: it does not ship](../figures/tuned-gain.png)",
        "![Which dimensions matter](../figures/tuned-importances.png)",
    ]
    for domain in TRIALS:
        domain_rows = [row for row in rows if row["domain"] == domain]
        if domain_rows:
            parts.append(f"## {domain}\n\n{table(domain_rows)}")
    return "\n\n".join(parts) + "\n"


def _worse(rows: Sequence[Row]) -> str:
    """What ships though its mean on test is worse: validation, which chose it, said otherwise."""
    if not rows:
        return "No shape that ships is worse on test."
    lines = [f"- {row['arch']} on {row['domain']}: × {ratio(row)[0]:.3f}" for row in rows]
    return "\n".join([f"The mean on test is worse for {len(rows)} of these:", "", *lines])


def table(rows: Sequence[Row]) -> str:
    """One line for each architecture of a domain."""
    head = ["architecture", "trials", "reference", "tuned", "tuned / reference", "weights", "by"]
    lines = [head, ["---"] * len(head)]
    for row in rows:
        cells = [row["arch"], _trials(row)]
        cells += [_errors(row["reference"]["errors"]) + _scale(row)]
        cells += [_errors(row["tuned"]["errors"])]
        cells += [gain_text(row).removeprefix("error ")]
        cells += [f"{row['reference']['trainable']:,} → {row['tuned']['trainable']:,}"]
        first = sorted(row["importances"].items(), key=lambda item: -item[1])[:2]
        lines.append([*cells, ", ".join(f"{n} {100 * share:.0f} %" for n, share in first) or "–"])
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _trials(row: Row) -> str:
    counts = row["trials"]
    kept = f"{sum(counts.values())}, {counts.get('finished', 0)} to the end"
    return kept + (f" ({', '.join(row['narrowed'])})" if row["narrowed"] else "")


def _scale(row: Row) -> str:
    """What was tried beside the paper's shape, where it is better on validation."""
    if not row["starts"] or confirmed({**row, "found_reference": True}) == "reference":
        return ""
    tried = _start(row)
    return f"; {_errors(tried['errors'])} {tried['label']}"


def _errors(errors: Sequence[float]) -> str:
    mean = sum(errors) / len(errors)
    spread = math.sqrt(sum((e - mean) ** 2 for e in errors) / (len(errors) - 1))
    return f"{mean:.3f} ± {spread:.3f}"


def tuned_architectures(rows: Sequence[Row]) -> list[str]:
    """Those that rows are of, in the project's order."""
    present = {row["arch"] for row in rows}
    return [arch for arch in ARCHITECTURES if arch in present]


def gains(rows: Sequence[Row]) -> "Figure":
    """One column for each domain, one mark for each architecture."""
    domains = [d for d in TRIALS if any(row["domain"] == d for row in rows)]
    with figures.style():
        drawn, axes = figures.figure(1, len(domains), size=(1.6 + 1.7 * len(domains), 3.2),
                                     sharey=True, squeeze=False)  # fmt: skip
        names = tuned_architectures(rows)
        for panel, domain in zip(axes[0], domains, strict=True):
            for row in (row for row in rows if row["domain"] == domain):
                middle, low, high = ratio(row)
                place = names.index(row["arch"])
                reach = [[middle - low], [high - middle]]
                filled = "full" if row["ships"] == "tuned" else "none"
                panel.errorbar(middle, place, xerr=reach, fmt="o", ms=4, color=figures.MEASURED,
                               fillstyle=filled)  # fmt: skip
            panel.axvline(1.0, color=figures.LIMIT, linestyle="--")
            panel.set(title=domain, xlabel="error, tuned / reference")
        axes[0][0].set_yticks(range(len(names)), names)
        axes[0][0].invert_yaxis()
    return drawn


def importances(rows: Sequence[Row]) -> "Figure":
    """One map for each architecture: domains down, its dimensions across."""
    tuned = tuned_architectures(rows)
    down = math.ceil(len(tuned) / 2)
    with figures.style():
        drawn, axes = figures.figure(down, 2, size=(10.0, 2.75 * down), squeeze=False)
        for panel in axes.ravel()[len(tuned) :]:
            panel.set_axis_off()
        for panel, arch in zip(axes.ravel(), tuned, strict=False):
            arch_rows = [row for row in rows if row["arch"] == arch]
            names = sorted({name for row in arch_rows for name in row["importances"]})
            shares = [
                [row["importances"].get(name, math.nan) for name in names] for row in arch_rows
            ]
            panel.grid(visible=False)
            panel.set(title=arch)
            if names:
                panel.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
            panel.set_xticks(range(len(names)), names, rotation=40, ha="right", fontsize=7)
            panel.set_yticks(
                range(len(arch_rows)), [row["domain"] for row in arch_rows], fontsize=7
            )
            for y, line in enumerate(shares):
                for x, share in enumerate(line):
                    shade = "white" if share > 0.6 else "black"
                    label = "–" if math.isnan(share) else f"{100 * share:.0f}"
                    panel.text(x, y, label, ha="center", va="center", fontsize=6, color=shade)
        drawn.suptitle(
            "Importance of each dimension [%], PED-ANOVA; –: not searched, or fewer than 15 trials",
            fontsize=10,
        )
    return drawn


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("sets", type=Path, help="a folder with a set for each domain")
    parser.add_argument("work", type=Path, help="studies and runs go here")
    parser.add_argument("--domain", nargs="+", default=list(TRIALS), choices=list(TRIALS))
    parser.add_argument("--arch", nargs="+", default=[*ARCHITECTURES], choices=[*ARCHITECTURES])
    parser.add_argument("--trials", type=int, help="of each study; default: by domain")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="pairs at a time")
    return parser.parse_args()


if __name__ == "__main__":
    main()
