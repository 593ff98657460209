"""`wakedeploy data`: make, import and describe episode sets."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click

from wakedeploy.cli.groups import Group
from wakedeploy.cli.output import json_option, print_table, stage_bars, warn, write_json
from wakedeploy.core.errors import UnusableInput

if TYPE_CHECKING:
    from wakedeploy.core.episodes import EpisodeSet

_OUT = click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    required=True,
    help="Folder to write.",
)

_COUNTED = ("files", "independent")  # recordings of each split, where a set's provenance tells


@click.group(cls=Group)
def command() -> None:
    """Make episodes by simulation, import recordings, describe a set.

    \b
    Example:
        wakedeploy data make gantry --out sets/gantry --minutes 30 --seed 0
        wakedeploy data show sets/gantry
    """


@command.group()
def make() -> None:
    """Simulate a domain."""


@make.command("gantry")
@_OUT
@click.option("--minutes", type=click.FloatRange(0.1, 10_000), default=30.0, show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option(
    "--rig", "rig_path", type=click.Path(path_type=Path), help="Default: the default rig."
)
@click.option(
    "--package",
    "packages",
    type=click.Path(dir_okay=False, path_type=Path),
    multiple=True,
    help="Fly this predictor in the flights with feedforward; may be repeated.",
)
@json_option
def make_gantry(
    out: Path,
    minutes: float,
    seed: int,
    rig_path: Path | None,
    packages: tuple[Path, ...],
    json_path: Path | None,
) -> None:
    """Fly the simulated gantry closed loop: half PID alone, half with feedforward.

    The feedforward is the true force, now and at the rig's lead, unless packages are given.

    \b
    Example:
        wakedeploy data make gantry --out sets/gantry --minutes 30 --seed 0
        wakedeploy data make gantry --out sets/second --package gru.onnx
    """
    _make("gantry", out, json_path, minutes=minutes, seed=seed, rig=rig_path, packages=packages)


@make.command("downwash")
@_OUT
@click.option("--minutes", type=click.FloatRange(0.1, 10_000), default=30.0, show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option(
    "--spread",
    type=click.FloatRange(0.0, 0.75),
    default=0.0,
    show_default=True,
    help="Draw wake speed, diffusivity and separation within this share of the paper's.",
)
@json_option
def make_downwash(
    out: Path, minutes: float, seed: int, spread: float, json_path: Path | None
) -> None:
    """Fly two planar multicopters one above the other in the paper's 2D wake field.

    \b
    Example:
        wakedeploy data make downwash --out sets/downwash --minutes 30 --seed 0
    """
    _make("downwash", out, json_path, minutes=minutes, seed=seed, spread=spread)


@make.command("ship")
@_OUT
@click.option("--minutes", type=click.FloatRange(0.1, 10_000), default=120.0, show_default=True)
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True)
@click.option(
    "--level",
    type=click.Choice(["slender", "vortex"], case_sensitive=False),
    default="vortex",
    show_default=True,
    help="Slender bodies (no memory, added mass of deep water), or vortices with wakes.",
)
@json_option
def make_ship(
    out: Path,
    minutes: float,
    seed: int,
    level: Literal["slender", "vortex"],
    json_path: Path | None,
) -> None:
    """Sail two ships past each other in a shallow channel: encounters and overtaking.

    \b
    Example:
        wakedeploy data make ship --out sets/ship --minutes 120 --seed 0
    """
    _make("ship", out, json_path, minutes=minutes, seed=seed, level=level)


def _make(domain: str, out: Path, json_path: Path | None, **settings: Any) -> None:
    """Simulate a set, keep it, describe it."""
    from wakedeploy.api.sets import make_set

    _require_writable(out)
    with stage_bars() as bars:
        made = make_set(domain, progress=bars, **settings)
    made.write(out)
    _describe(made, out, json_path)


def _require_writable(out: Path) -> None:
    """UnusableInput where a set could not be written, before hours of simulation."""
    if out.exists() and not out.is_dir():
        raise UnusableInput(f"{out}: is a file; give a folder for the episode set.")
    there = next(path for path in (out, *out.absolute().parents) if path.exists())
    if not there.is_dir() or not os.access(there, os.W_OK | os.X_OK):
        raise UnusableInput(f"{out}: {there} cannot be written to; choose another --out.")


@command.group("import")
def import_() -> None:
    """Import public recordings in their original layout."""


def _import(domain: str, path: Path, out: Path, json_path: Path | None) -> None:
    """Read recordings as a set, keep it, describe it."""
    from wakedeploy.api.sets import import_set

    with stage_bars() as bars:
        made = import_set(domain, path, progress=bars)
    made.write(out)
    _describe(made, out, json_path)


@import_.command("fish")
@click.argument("path", type=click.Path(path_type=Path))
@_OUT
@json_option
def import_fish(path: Path, out: Path, json_path: Path | None) -> None:
    """Import recordings of a flag behind a flapping foil (…_Foil, …_Flag2 and …_LDV.mat).

    PATH is the repository, its data folder, or any folder with such files.

    \b
    Example:
        wakedeploy data import fish TE-analysis-for-multi-pathway-interaction --out sets/fish
    """
    _import("fish", path, out, json_path)


@import_.command("flaredw")
@click.argument("path", type=click.Path(path_type=Path))
@_OUT
@json_option
def import_flaredw(path: Path, out: Path, json_path: Path | None) -> None:
    """Import co-simulations of two quadrotors (FlareDW's .npz files, 200 Hz).

    PATH is the repository's folder agile_manuevers, or any folder with such files.

    \b
    Example:
        wakedeploy data import flaredw CDP-CFD/agile_manuevers --out sets/quadrotor
    """
    _import("quadrotor", path, out, json_path)


@import_.command("crazyflie")
@click.argument("path", type=click.Path(path_type=Path))
@_OUT
@json_option
def import_crazyflie(path: Path, out: Path, json_path: Path | None) -> None:
    """Import flights of two Crazyflies that swap places (.npz, 100 Hz, real downwash).

    PATH is any folder with swap_ss_*, swap_sl_* or swap_ll_* (small, large; in sl a is the
    large one), a flight each, which becomes two episodes, one for either sufferer. Keys: t [s]; a_
    and b_ each with pos [m], vel [m/s], acc [m/s², gravity included], quat_xyzw, motor_thrust [N],
    pwm [0…1], vbat [V].

    \b
    Example:
        wakedeploy data import crazyflie swaps --out sets/crazyflie
    """
    _import("crazyflie", path, out, json_path)


@import_.command("table")
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--columns",
    "columns_path",
    type=click.Path(dir_okay=False, path_type=Path),
    required=True,
    help="What the columns mean.",
)
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), help="Folder to write.")
@click.option("--guess", is_flag=True, help="Write a first --columns for the first of FILES.")
@json_option
def import_table(
    files: tuple[Path, ...],
    columns_path: Path,
    out: Path | None,
    guess: bool,
    json_path: Path | None,
) -> None:
    """Import logs of any system: CSV, Parquet, npz, HDF5, MATLAB, MCAP, rosbag2 or ULog.

    FILES are logs, or folders of files that belong together. The file of --columns says which
    column is which observation or force, its unit, and how time is kept (docs/own-logs.md).

    \b
    Example:
        wakedeploy data import table axis.csv --guess --columns columns.toml
        wakedeploy data import table axis*.csv --columns columns.toml --out sets/axis
    """
    if guess:
        _guess(files[0], columns_path)
        return
    if out is None:
        raise click.UsageError("Missing option '--out'.")
    from wakedeploy.api.logs import import_table as read

    _require_writable(out)
    with stage_bars() as bars:
        made = read(files, columns_path, progress=bars)
    made.write(out)
    _describe(made, out, json_path)
    for note in made.provenance.get("notes", ()):  # type: ignore[union-attr]
        warn(f"{note}.")


def _guess(log: Path, columns_path: Path) -> None:
    """Write a first columns.toml, never over another one."""
    from wakedeploy.api.logs import guess_columns
    from wakedeploy.core.files import begun

    text = guess_columns(log)
    try:
        with begun(columns_path) as path:
            path.write_text(text, "utf-8")
    except FileExistsError as error:
        raise UnusableInput(
            f"{columns_path}: is there already; delete it, or choose another --columns."
        ) from error
    click.echo(f"Wrote {columns_path}: give the columns that you need a role, then import.")


@command.command()
@click.argument("folder", type=click.Path(path_type=Path))
@json_option
def show(folder: Path, json_path: Path | None) -> None:
    """Describe the episode set in FOLDER: splits, channels and their ranges.

    \b
    Example:
        wakedeploy data show sets/gantry
    """
    from wakedeploy.core.episodes import read_episode_set

    _describe(read_episode_set(folder), folder, json_path)


def _describe(described: "EpisodeSet", folder: Path, json_path: Path | None) -> None:
    splits, channels = _splits(described), _channels(described)
    title = (
        f"{folder}: {described.domain}, {described.rate_hz:g} Hz, window {described.window_s:g} s"
    )
    shown = ["split", *(n for n in (*_COUNTED, "episodes") if n in splits[0])]
    cells = [[*(str(s[n]) for n in shown), f"{s['seconds']:.1f}"] for s in splits]
    print_table(title, [*shown, "seconds"], cells)
    numbers = ("min", "mean", "sd", "max")
    print_table(
        "channels",
        ["channel", "kind", "unit", *numbers],
        [[c["name"], c["kind"], c["unit"], *(f"{c[n]:.4g}" for n in numbers)] for c in channels],
    )
    if json_path:
        result = {"domain": described.domain, "rate_hz": described.rate_hz}
        result |= {"window_s": described.window_s, "sha256": described.sha256}
        result |= {"splits": splits, "channels": channels}
        write_json(json_path, result | {"provenance": dict(described.provenance)})


def _splits(described: "EpisodeSet") -> list[dict[str, Any]]:
    from wakedeploy.core.episodes import SPLITS

    parts = {split: described.part(split) for split in SPLITS}
    recordings = _recordings(described)
    return [
        {
            "split": split,
            **recordings.get(split, {}),
            "episodes": len(part),
            "seconds": sum(map(len, part)) / described.rate_hz,
        }
        for split, part in parts.items()
    ]


def _recordings(described: "EpisodeSet") -> dict[str, dict[str, int]]:
    """How many recordings each split has; nothing where the provenance does not tell all of it."""
    from wakedeploy.core.episodes import SPLITS

    told: Any = described.provenance.get("recordings")
    try:
        return {split: {name: int(told[split][name]) for name in _COUNTED} for split in SPLITS}
    except (KeyError, TypeError, ValueError, OverflowError):
        return {}


def _channels(described: "EpisodeSet") -> list[dict[str, Any]]:
    import numpy as np

    rows: list[dict[str, Any]] = []
    for kind, channels in (("observation", described.observation), ("force", described.force)):
        joined = np.concatenate([e.arrays[kind] for e in described.episodes]).astype(float)
        for channel, values in zip(channels, joined.T, strict=True):
            statistics = {"min": values.min(), "mean": values.mean()}
            statistics |= {"sd": values.std(), "max": values.max()}
            rows.append({"name": channel.name, "kind": kind, "unit": channel.unit} | statistics)
    return rows
