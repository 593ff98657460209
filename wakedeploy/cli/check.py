"""`wakedeploy check`: every promise of a package that can be tried without torch."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.output import print_table, progress, write_json
from wakedeploy.errors import CheckFailed, UnusableInput

if TYPE_CHECKING:
    from wakedeploy.manifest import Manifest

_FILE = click.Path(dir_okay=False, path_type=Path)


@click.command()
@click.argument("file", type=_FILE)
@click.option("--rig", "rig_path", type=_FILE, help="Also: can the loop of this rig fly it?")
@click.option("--json", "json_path", type=_FILE, help="Also write the result as JSON.")
def command(file: Path, rig_path: Path | None, json_path: Path | None) -> None:
    """Verify the package FILE on this machine: manifest, hash, graph, rollout, manners, limits.

    Its example rollout is replayed and compared with what the training-time forward gave. With
    --rig its rate, channels and lead have to be those of that rig's loop. Exit status 1 when a
    check fails, 2 when FILE is no usable package, or none for that rig.

    \b
    Example:
        wakedeploy check gru.onnx --json check.json
        wakedeploy check gru.onnx --rig rig.toml
    """
    from runtime.replay import replay
    from wakedeploy.package import read_package

    try:
        package = read_package(file)
    except UnusableInput as error:
        unknown = dict.fromkeys(("arch", "trainable", "parity"))
        _write(json_path, {"ok": False} | unknown | {"why": str(error)})
        raise
    manifest = package.manifest
    result: dict[str, Any] = {"arch": manifest.arch, "trainable": manifest.trainable}
    exported = manifest.parity.model_dump(include={"max_abs", "max_rel", "steps"})
    try:
        with progress(f"Checking {file}", 1):
            replayed = replay(package)
    except CheckFailed as error:
        _write(json_path, {"ok": False} | result | {"parity": exported, "why": str(error)})
        raise
    try:
        fits = _fits(manifest, rig_path) if rig_path else []
    except UnusableInput as error:
        _write(json_path, {"ok": False} | result | {"parity": exported, "why": str(error)})
        raise
    difference = replayed.difference
    rows = [
        ["manifest, hash and graph", "agree"],
        ["reset, two runners, a batch", "keep apart"],
        ["example rollout here", f"{difference.max_rel:.1e} over {replayed.steps} steps"],
        ["driven over its ranges, 25 % beyond", f"limited in {100 * replayed.limited:.1f} %"],
        ["parity when exported", f"{exported['max_rel']:.1e} over {exported['steps']} steps"],
        ["limit", f"{manifest.parity.limit:.1e}"],
        *fits,
    ]
    print_table(f"{file}: {manifest.arch} for {manifest.domain}, as promised", ["", ""], rows)
    here = {"max_rel": difference.max_rel, "max_abs": difference.max_abs, "steps": replayed.steps}
    here |= {"limited": replayed.limited}
    _write(json_path, {"ok": True} | result | {"parity": exported, "replay": here})


def _fits(manifest: "Manifest", rig_path: Path) -> list[list[str]]:
    """What the package is for, once it is known to be for this rig's loop; UnusableInput if not."""
    from runtime.loop import require_wait
    from runtime.request import require_fit
    from wakedeploy.rig import read_rig

    rig = read_rig(rig_path)
    require_fit(manifest, rig)
    require_wait(rig)
    return [[f"rate, channels and lead of {rig_path}", f"fit, {manifest.lead_s:g} s ahead"]]


def _write(path: Path | None, result: dict[str, Any]) -> None:
    if path:
        write_json(path, result)
