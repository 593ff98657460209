"""`wakedeploy export`: a trained run as one checked .onnx file."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.output import print_table, progress, write_json
from wakedeploy.errors import UnusableInput

if TYPE_CHECKING:
    from wakedeploy.episodes import EpisodeSet
    from wakedeploy.package import Package

_DEPTH = 4  # how many folders down the set of a run is looked for
_FOLDER = click.Path(file_okay=False, path_type=Path)
_FILE = click.Path(dir_okay=False, path_type=Path)


@click.command()
@click.option("--arch", required=True, help="One of the eight names.")
@click.option("--run", "run", type=_FOLDER, help="A run's folder. Default: the newest of ARCH.")
@click.option(
    "--runs", type=_FOLDER, default=Path("runs"), show_default=True, help="Where to look for it."
)
@click.option("--data", type=_FOLDER, help="The set it was trained on. Default: looked for nearby.")
@click.option("--out", type=_FILE, help="Default: ARCH.onnx.")
@click.option("--json", "json_path", type=_FILE, help="Also write the result as JSON.")
def command(
    arch: str,
    run: Path | None,
    runs: Path,
    data: Path | None,
    out: Path | None,
    json_path: Path | None,
) -> None:
    """Turn a trained predictor into one self-contained file that the Pi runs.

    The exported graph is stepped beside the training-time forward over at least 3,200 samples; a
    difference above the limit leaves no file and exits with 1.

    \b
    Example:
        wakedeploy export --arch gru
        wakedeploy export --arch gru --run runs/gantry/gru/s0 --out gru.onnx --json gru.json
    """
    from export.packaging import export_run
    from trainers.runs import load_run, newest_run

    chosen = run or newest_run(runs, arch)
    trained = load_run(chosen)
    if trained.config.arch != arch:
        raise UnusableInput(
            f"{chosen} is a run of {trained.config.arch}, not of {arch}; give another --run or"
            " --arch."
        )
    click.echo(f"Exporting {chosen}, finished {trained.metrics.finished_utc}.")
    path = out or Path(f"{arch}.onnx")
    episodes = _episodes(trained.config.data_sha256, data, chosen)
    with progress("Exporting", 1) as bar:
        package = export_run(trained, episodes, path, bar.update)
    _tell(package, path)
    if json_path:
        write_json(json_path, _json(package, path))


def _episodes(data_sha256: str, data: Path | None, run: Path) -> "EpisodeSet":
    """The set given, or the one below this folder that the run was trained on."""
    from wakedeploy.episodes import DESCRIPTION, read_episode_set, stated_sha256

    if data is not None:
        return read_episode_set(data)
    for depth in range(1, _DEPTH + 1):
        for description in sorted(Path().glob(f"{'*/' * depth}{DESCRIPTION}")):
            with contextlib.suppress(UnusableInput):  # not every dataset.json here is a set
                if stated_sha256(description.parent) == data_sha256:
                    return read_episode_set(description.parent)
    raise UnusableInput(f"The set that {run} was trained on is not near this folder; pass --data.")


def _tell(package: "Package", path: Path) -> None:
    manifest, parity = package.manifest, package.manifest.parity
    memory = manifest.memory
    window = f", {memory.k} snapshots" if memory.kind == "window" else ""
    rows = [
        ["parameters", f"{manifest.trainable:,} trainable, {manifest.frozen:,} frozen"],
        ["memory", f"{memory.kind}{window}, full after {manifest.warm_up_steps} steps"],
        ["rate, lead", f"{manifest.rate_hz:g} Hz, {manifest.lead_s:g} s"],
        *(
            [f"{c.name} in training", f"{c.min:.3g} to {c.max:.3g} {c.unit}"]
            for c in manifest.force
        ),
        ["parity", f"{parity.max_rel:.1e} of {parity.limit:.1e} over {parity.steps} steps"],
    ]
    if parity.float64_rel is not None:
        rows.append(["own float32 error", f"{parity.float64_rel:.1e} against float64"])
    print_table(f"{path} ({len(package.model_bytes) / 1e3:.0f} kB)", ["", ""], rows)


def _json(package: "Package", path: Path) -> dict[str, Any]:
    told = package.manifest.model_dump(include={"arch", "trainable", "frozen", "lead_s"})
    parity = package.manifest.parity.model_dump(include={"max_abs", "max_rel", "steps", "limit"})
    return told | {"parity": parity, "file": str(path)}
