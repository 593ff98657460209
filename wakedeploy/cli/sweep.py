"""`wakedeploy sweep`: architectures × sets × seeds × settings, here or on a cluster."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.names import PRESET
from wakedeploy.cli.output import (
    json_option,
    mean_and_spread,
    print_table,
    progress,
    told_when_stopped,
    what_differs,
    write_json,
)
from wakedeploy.cli.training_options import architectures_option, device_option
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.interruption import interruptible
from wakedeploy.core.names import architectures, meant

if TYPE_CHECKING:
    from wakedeploy.sweep.executor import Executor
    from wakedeploy.sweep.plan import Plan
    from wakedeploy.sweep.run import Report

_PLAN_FILE = click.Path(dir_okay=False, path_type=Path)


@click.command()
@click.argument("plan", type=_PLAN_FILE, required=False)
@click.option("--data", help="SET[,SET…]: folders of sets, or names of sets that PLAN generates.")
@architectures_option(None, otherwise="all")
@click.option("--seeds", type=click.IntRange(1, 1000), help="How many. Default: 1.")
@click.option("--lead", help="Seconds[,…] ahead. Default: what the set states, or 0.")
@click.option(
    "--preset",
    type=PRESET,
    metavar="reference|tuned|FILE[,…]",
    help="What the other options change; a file is for its architecture. Default: reference.",
)
@click.option("--epochs", help="N[,N…]. Default: 60.")
@click.option("--learning-rate", help="RATE[,RATE…], peak. Default: 0.003, Mamba 0.01.")
@click.option(
    "--hyper",
    multiple=True,
    metavar="ARCH.NAME=V[,V…]",
    help="Values of a hyper-parameter; may be repeated.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default="sweep",
    show_default=True,
    help="Folder for results, runs and generated sets; what is done there is not done again.",
)
@click.option(
    "--workers", type=click.IntRange(1, 1024), help="Processes here. Default: one per core."
)
@click.option("--scheduler", metavar="ADDRESS", help="A dask scheduler instead: tcp://HOST:PORT.")
@device_option
@click.option("--retry-failed", is_flag=True, help="Try jobs again that failed before.")
@json_option
def command(
    plan: Path | None,
    out: Path,
    workers: int | None,
    scheduler: str | None,
    device: str,
    retry_failed: bool,
    json_path: Path | None,
    **asked: Any,
) -> None:
    """Train every combination that a plan or options ask for, and generate sets.

    Every job is a row of OUT/results.jsonl as soon as it is finished, and of OUT/results.csv at the
    end. Asked again, a sweep trains only what has no row; a changed plan adds rows. (Trained models
    lie in OUT/runs: where they were deleted, take their rows out of OUT/results.jsonl to have them
    again.) A job that fails is a row with its reason and makes the exit status 1. Options replace
    values of PLAN.

    PLAN is TOML; where it has a value it may have a list, which means each of its values, but for
    [[generate]], which is one set. Without data it only generates.

    \b
        data = ["short", "sets/fish"]       # sets below, or folders beside this file
        arch = ["gru", "tcn"]               # or "all"
        seeds = 3
        lead = [0.0, 0.1]                   # s; default: what the set states
        preset = ["reference", "tuned"]     # or files of `tune`; default: reference
        [settings]                          # epochs, learning_rate, batch, patience, …
        epochs = 20
        [hyper.gru]
        hidden = [16, 32]
        [[generate]]                        # minutes of gantry, downwash or ship
        name = "short"
        domain = "gantry"
        minutes = 5
        seed = 1
        settings = {}                       # gantry: rig; downwash: spread; ship: level

    With --scheduler the jobs run on an existing dask.distributed cluster, whose workers need this
    version of Python and wakedeploy but no folder in common: sets and runs travel. A worker trains
    one model at a time, so start them with `dask worker ADDRESS --nthreads 1`.

    \b
    Example:
        wakedeploy sweep plan.toml --out sweep
        wakedeploy sweep --data sets/gantry --arch gru,tcn --seeds 3 --hyper gru.hidden=16,32
        wakedeploy sweep plan.toml --out sweep --scheduler tcp://head:8786
    """
    from wakedeploy.sweep.plan import read_plan
    from wakedeploy.sweep.run import require_ours

    wanted = read_plan(plan, _options(asked))
    require_ours(out)
    executor = _executor(out, workers, scheduler, device)
    _tell(_swept(wanted, out, executor, device, retry_failed), out, json_path)


def _swept(
    wanted: "Plan", out: Path, executor: "Executor", device: str, retry_failed: bool
) -> "Report":
    """The sweep with a bar that counts; Ctrl-C, or a batch system's end, says how to go on."""
    from wakedeploy.sweep.run import sweep

    stopped = (
        f"Stopped; {out / 'results.jsonl'} has the rows of the jobs that had ended, if any, and the"
        " same command goes on with the rest."
    )
    ended = told_when_stopped(stopped)
    with ended, interruptible(), progress("Jobs", wanted.jobs, counted=True) as bar:
        return sweep(
            wanted,
            out,
            executor,
            device=device,
            retry_failed=retry_failed,
            on_progress=bar.update,
        )


def _options(asked: dict[str, Any]) -> dict[str, Any]:
    """The options as a plan has them; those that were not given are left out."""
    plan: dict[str, Any] = {}
    if asked["data"]:
        plan["data"] = _names(asked["data"])
    if asked["arch"]:
        plan["arch"] = list(asked["arch"])
    if asked["seeds"]:
        plan["seeds"] = asked["seeds"]
    if asked["preset"]:
        plan["preset"] = _names(asked["preset"])
    if asked["lead"]:
        plan["lead"] = _values("--lead", asked["lead"])
    for name in ("epochs", "learning_rate"):
        if asked[name]:
            option = "--" + name.replace("_", "-")
            plan.setdefault("settings", {})[name] = _values(option, asked[name])
    for entry in asked["hyper"]:
        place, equals, text = entry.partition("=")
        arch, dot, name = place.partition(".")
        if not (equals and dot and arch and name):
            raise UnusableInput(f"--hyper {entry}: write ARCH.NAME=VALUE[,VALUE…].")
        arch, values = meant(arch, architectures()) or arch, _values(f"--hyper {entry}", text)
        plan.setdefault("hyper", {}).setdefault(arch, {})[name] = values
    return plan


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


def _values(option: str, text: str) -> list[Any]:
    values = []
    for item in text.split(","):
        try:
            value = json.loads(item)
        except json.JSONDecodeError as error:
            raise UnusableInput(f"{option}: '{item}' is not a number.") from error
        values.append(value)
    return values


def _executor(out: Path, workers: int | None, scheduler: str | None, device: str) -> "Executor":
    if scheduler is not None:
        if workers is not None:
            raise UnusableInput("--workers is for this machine; leave it out with --scheduler.")
        from wakedeploy.sweep.cluster import Cluster

        return Cluster(
            scheduler,
            on_misfit=lambda problem: click.echo(f"{problem} It gets no job.", err=True),
            device=device,
        )
    from trainers.training.device import require_cuda
    from wakedeploy.sweep.executor import LocalProcesses
    from wakedeploy.sweep.jobs import RUNS

    if device == "cuda":
        require_cuda()
    return LocalProcesses(out / RUNS, workers)


def _tell(report: "Report", out: Path, json_path: Path | None) -> None:
    """Print the results by set; CheckFailed where jobs failed."""
    done = [row for row in report.rows if row["state"] == "done"]
    trained = [row for row in done if row["kind"] == "train"]
    for data in dict.fromkeys(row["data"] for row in trained):
        of_set = [row for row in trained if row["data"] == data]
        devices = ", ".join(dict.fromkeys(row["device"] for row in of_set))
        print_table(f"{data}: test episodes, {devices}", *_table(of_set))
    write_json(json_path, {"rows": report.rows, "waiting": report.waiting})
    click.echo(
        f"{len(done)} of {len(report.rows) + report.waiting} jobs are done; {report.begun} were run"
        f" now. Table: {out / 'results.csv'}"
    )
    _tell_of_other_commits(report)
    if report.failed:
        first = report.failed[0]
        name = first.get("arch", first["kind"])
        waiting = f", and {report.waiting} wait for a set that failed" if report.waiting else ""
        raise CheckFailed(
            f"{len(report.failed)} jobs failed{waiting}; the first, {name} on {first['data']}:"
            f" {first['reason']}; --retry-failed tries them again."
        )


def _tell_of_other_commits(report: "Report") -> None:
    from wakedeploy.core.commit import present_commit

    others = report.of_other_commits(present_commit())
    if others:
        made = ", ".join(f"{count} by {commit}" for commit, count in sorted(others.items()))
        click.echo(
            f"Rows are of another commit than this one, {present_commit()}: {made}; a new --out, on"
            " workers of this commit, does their jobs again.",
            err=True,
        )


def _table(rows: Sequence[dict[str, Any]]) -> tuple[list[str], list[list[str]]]:
    """One line for each architecture with its settings, mean ± spread over the seeds."""
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        key = json.dumps([row[name] for name in ("arch", "lead_s", "settings", "hyper")])
        groups.setdefault(key, []).append(row)
    groups = {
        key: [row | {"preset": _presets(runs)} for row in runs] for key, runs in groups.items()
    }
    rows = [row for runs in groups.values() for row in runs]
    tests = [row["test"] for row in rows]
    channels = [
        name for name in tests[0]["rmse"] if all(name in t["rmse"].keys() & t["r2"] for t in tests)
    ]
    columns = ["architecture", "settings", "seeds", "trainable"]
    columns += [f"{kind} {name}" for name in channels for kind in ("RMSE", "R²")]
    lines = []
    for runs in groups.values():
        line = [
            runs[0]["arch"],
            _varied(runs[0], rows),
            str(len(runs)),
            f"{runs[0]['trainable']:,}",
        ]
        for name in channels:
            line.append(mean_and_spread([row["test"]["rmse"][name] for row in runs], ".4g"))
            line.append(mean_and_spread([row["test"]["r2"][name] for row in runs], ".4f"))
        lines.append([*line, mean_and_spread([row["seconds"] for row in runs], ".1f")])
    return [*columns, "seconds"], lines


def _presets(rows: Sequence[dict[str, Any]]) -> str:
    """By which presets rows of one configuration came; seeds may have been added with others."""
    return ", ".join(dict.fromkeys(name for row in rows for name in row["preset"].split(", ")))


def _varied(row: dict[str, Any], rows: Sequence[dict[str, Any]]) -> str:
    """What distinguishes a row from others of its architecture, the seed aside.

    Presets differ in much; it is enough to name them.
    """

    def configuration(row: dict[str, Any]) -> dict[str, Any]:
        return {"lead_s": row["lead_s"], **row["settings"], **row["hyper"]}

    of_arch = [other for other in rows if other["arch"] == row["arch"]]
    alike = [configuration(other) for other in of_arch if other["preset"] == row["preset"]]
    named = what_differs(
        {"preset": row["preset"]}, [{"preset": other["preset"]} for other in of_arch]
    )
    return ", ".join(filter(None, (named, what_differs(configuration(row), alike))))
