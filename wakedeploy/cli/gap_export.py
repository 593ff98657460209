"""`wakedeploy gap export`: the corrected model, a log or a set for other programs."""

from pathlib import Path

import click

from wakedeploy.cli.output import progress
from wakedeploy.core.errors import UnusableInput

_FILE = click.Path(dir_okay=False, path_type=Path)
_PATH = click.Path(path_type=Path)


@click.command("export")
@click.option("--rig", "rig_path", type=_FILE, help="Write this rig's model into the folder --out.")
@click.option("--log", "log_path", type=_FILE, help="Write this run log into the file --out.")
@click.option("--set", "set_path", type=_PATH, help="Write this episode set into the file --out.")
@click.option("--out", required=True, type=_PATH, help="A folder, or FILE.parquet, or FILE.mat.")
def export(rig_path: Path | None, log_path: Path | None, set_path: Path | None, out: Path) -> None:
    """Take a model, a run log or an episode set to another program.

    A rig becomes gantry_model.py (numpy alone) and gantry_model.m (MATLAB or Octave), its effects
    with their equations and values included. Logs and sets become Parquet or .mat; logs also CSV.

    \b
    Example:
        wakedeploy gap export --rig corrected.toml --out model
        wakedeploy gap export --log flight.mcap --out flight.parquet
        wakedeploy gap export --set sets/gantry --out gantry.mat
    """
    given = [path for path in (rig_path, log_path, set_path) if path is not None]
    if len(given) != 1:
        raise UnusableInput("Say what to export: one of --rig FILE, --log FILE and --set FOLDER.")
    if rig_path is not None:
        _export_rig(rig_path, out)
    elif log_path is not None:
        export_log(log_path, out)
    else:
        _export_set(given[0], out)


def _export_rig(rig_path: Path, out: Path) -> None:
    from wakedeploy.gap.model_export.files import export_rig
    from wakedeploy.rig.file import read_rig

    rig = read_rig(rig_path)
    if out.exists() and not out.is_dir():
        raise UnusableInput(f"{out}: is a file; give a folder for the model.")
    effects = ", ".join(entry.name for entry in rig.effect) or "no effects"
    with progress("Writing the model", 1):
        paths = export_rig(rig, out)
    for path in paths:
        click.echo(f"{path}: the rig's model with {effects}.")


def export_log(log_path: Path, out: Path) -> None:
    """Write a run log as CSV, Parquet or .mat, as the name of `out` ends, and say so."""
    from wakedeploy.core.runlog import read_run_log
    from wakedeploy.core.tables import LOG_KINDS, require_kind, write_log

    require_kind(out, LOG_KINDS)
    with progress(f"Writing {out}", 1):
        log = read_run_log(log_path)
        write_log(log, out)
    click.echo(f"{out}: {len(log)} ticks, {len(log.columns)} columns.")


def _export_set(set_path: Path, out: Path) -> None:
    from wakedeploy.core.episodes import read_episode_set
    from wakedeploy.core.tables import require_kind, write_set

    require_kind(out)
    with progress(f"Writing {out}", 1):
        made = read_episode_set(set_path)
        write_set(made, out)
    samples = sum(map(len, made.episodes))
    click.echo(f"{out}: {len(made.episodes)} episodes, {samples} samples.")
