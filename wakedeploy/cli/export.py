"""`wakedeploy export`: a trained run as one checked .onnx file."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from wakedeploy.cli.export_c import CWish, c_of_package, c_of_run, c_options
from wakedeploy.cli.names import ARCHITECTURE
from wakedeploy.cli.output import Written, print_table, progress, stage_bars, write_json
from wakedeploy.core.errors import UnusableInput

if TYPE_CHECKING:
    from trainers.trained_run import TrainedRun
    from wakedeploy.core.episodes import EpisodeSet
    from wakedeploy.core.package import Package

_MOST_LISTED = 12
_FOLDER = click.Path(file_okay=False, path_type=Path)


@click.command()
@click.option("--run", "run", type=_FOLDER, help="A run's folder, also as it is called in --runs.")
@click.option("--arch", type=ARCHITECTURE, metavar="NAME", help="The newest run of this one.")
@click.option(
    "--runs",
    type=_FOLDER,
    default=Path("runs"),
    show_default=True,
    help="Where runs lie; one that holds a single run says enough.",
)
@click.option("--data", type=_FOLDER, help="The set it was trained on. Default: the run knows.")
@click.option("--out", type=Written(), help="Default: ARCH.onnx.")
@c_options
@click.option("--json", "json_path", type=Written(), help="Also write the result as JSON.")
def command(
    arch: str | None,
    run: Path | None,
    runs: Path,
    data: Path | None,
    out: Path | None,
    json_path: Path | None,
    **c: Any,
) -> None:
    """Turn a trained predictor into one self-contained file that the Pi runs, and into C.

    Without options it is the newest run in ./runs, on the set that it was trained on.

    The exported graph is stepped beside the training-time forward over at least 3,200 samples; a
    difference above the limit leaves no file and exits with 1.

    With --c it also becomes plain C99 for a microcontroller, or for a Pi without onnxruntime: one
    source, its header, a self-test and a page. It is compiled here and stepped the same way before
    the folder is written. --package does that with a package that is there already.

    \b
    Example:
        wakedeploy export
        wakedeploy export --arch gru --out gru.onnx --json gru.json
        wakedeploy export --run runs/gantry/gru/s0
        wakedeploy export --arch gru --c gru_c
        wakedeploy export --package gru.onnx --c gru_int8 --weights int8
    """
    wanted = CWish.of(c)
    if wanted.package is not None:
        for option in ("run", "arch", "runs", "out"):
            if _is_given(option):
                raise UnusableInput(
                    f"--{option} makes a package, and --package has one; give one of the two."
                )
        write_json(json_path, c_of_package(wanted, data))
        return
    with progress("Loading PyTorch", 1):
        from trainers.trained_run import load_run
        from wakedeploy.api.predictors import export
    from wakedeploy.core.package import Package

    is_bare = run is None and arch is None and not _is_given("runs")
    chosen, which = _chosen(run, runs, arch, is_bare=is_bare)
    trained = load_run(chosen)
    if arch not in (None, trained.config.arch):
        raise UnusableInput(
            f"{chosen} is a run of {trained.config.arch}, not of {arch}; give another --run or"
            " --arch."
        )
    click.echo(f"Exporting {chosen}, {which}finished {trained.metrics.finished_utc}.")
    episodes = None if wanted.folder is None else _set_of(trained, data)
    with stage_bars() as bars:
        made = export(trained, out, data=episodes or data, progress=bars)
    package = made.package
    assert isinstance(package, Package), "without c= it is no C"
    _tell(package, made.path)
    result = _json(package, made.path)
    if episodes is not None:
        result |= {"c": c_of_run(wanted, package, trained, episodes)}
    write_json(json_path, result)


def _set_of(run: "TrainedRun", data: Path | None) -> "EpisodeSet":
    """The set given, or where the run knows it to lie."""
    from trainers.trained_run import episodes_of
    from wakedeploy.core.episodes import read_episode_set

    return episodes_of(run) if data is None else read_episode_set(data)


def _is_given(option: str) -> bool:
    source = click.get_current_context().get_parameter_source(option)
    return source is not ParameterSource.DEFAULT


def _chosen(run: Path | None, runs: Path, arch: str | None, *, is_bare: bool) -> tuple[Path, str]:
    """The run that is asked for, and what tells it from the others there, with a comma behind it.

    UnusableInput lists the runs where none of several is asked for.
    """
    from trainers.training.runs import CONFIG, runs_of

    place = runs
    if run is not None:
        named = next((path for path in (run, runs / run) if (path / CONFIG).is_file()), None)
        if named is not None:
            return named, ""
        if not (run.is_dir() or (runs / run).is_dir()):
            raise UnusableInput(
                f"{run} is no run, neither here nor in {runs}; give the folder of one, such as"
                " runs/gantry/gru/s0."
            )
        place = run if run.is_dir() else runs / run
    found = runs_of(place, arch)
    if len(found) > 1 and arch is None and not is_bare:
        raise UnusableInput(
            f"{place} holds {len(found)} finished runs: {_listed(found, place)}; pick one by --run,"
            " or the newest of an architecture by --arch."
        )
    kind = "" if arch is None else f" of {arch}"
    return found[-1], f"the newest of {len(found)} runs{kind}, " if len(found) > 1 else ""


def _listed(runs: Sequence[Path], place: Path) -> str:
    """The newest runs below a folder, as `--run` takes them."""
    names = [str(run.relative_to(place)) for run in reversed(runs)]
    more = len(names) - _MOST_LISTED
    return ", ".join(names[:_MOST_LISTED]) + (f" and {more} more" if more > 0 else "")


def _tell(package: "Package", path: Path) -> None:
    manifest, parity = package.manifest, package.manifest.parity
    memory = manifest.memory
    window = f", {memory.k} snapshots" if memory.kind == "window" else ""
    rows = [
        ["parameters", f"{manifest.trainable:,} trainable, {manifest.frozen:,} frozen"],
        ["memory", f"{memory.kind}{window}, used from step {manifest.warm_up_steps} on"],
        ["rate, lead", f"{manifest.rate_hz:g} Hz, {manifest.lead_s:g} s"],
        *(
            [f"{c.name} in training", f"{c.min + 0.0:.3g} to {c.max + 0.0:.3g} {c.unit}"]
            for c in manifest.force
        ),
        ["parity", f"{parity.max_rel:.1e} of {parity.limit:.1e} over {parity.steps} steps"],
    ]
    if parity.float64_rel is not None:
        rows.append(["own float32 error", f"{parity.float64_rel:.1e} against float64"])
    print_table(f"{path} ({len(package.model_bytes) / 1e3:.0f} kB)", ["", ""], rows)


def _json(package: "Package", path: Path) -> dict[str, Any]:
    result = package.manifest.model_dump(include={"arch", "trainable", "frozen", "lead_s"})
    parity = package.manifest.parity.model_dump(include={"max_abs", "max_rel", "steps", "limit"})
    return result | {"parity": parity, "file": str(path)}
