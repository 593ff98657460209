"""`wakedeploy check`: every promise of a package that can be tried without torch."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.output import Written, print_table, progress, write_json
from wakedeploy.core.errors import CheckFailed, UnusableInput

if TYPE_CHECKING:
    from wakedeploy.core.manifest import Manifest

_FILE = click.Path(dir_okay=False, path_type=Path)


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--rig", "rig_path", type=_FILE, help="Also: can the loop of this rig fly it?")
@click.option("--json", "json_path", type=Written(), help="Also write the result as JSON.")
def command(file: Path, rig_path: Path | None, json_path: Path | None) -> None:
    """Verify the package FILE on this machine: manifest, hash, graph, rollout, manners, limits.

    A package may come from anyone. Whatever it asks for is bounded before it is run; then it is
    tried in a process of its own, which ends at 120 s of processor time or 1 GiB of memory. Its
    example rollout is replayed and compared with what the training-time forward gave, and it is
    driven over the ranges of its inputs and a quarter beyond. With --rig its rate, channels, forces
    and lead have to be those of that rig's loop. Exit status 1 when a check fails, 2 when FILE is
    no usable package, or none for that rig.

    A folder that `export --c` wrote is a program: check only one that you would run. Its self-test
    is compiled and run at -O2 and with the loop's flags.

    \b
    Example:
        wakedeploy check gru.onnx --json check.json
        wakedeploy check gru.onnx --rig rig.toml
        wakedeploy check gru_c
    """
    result: dict[str, Any] = {"ok": False, **dict.fromkeys(("arch", "trainable", "parity"))}
    try:
        rows = (_checked_c if file.is_dir() else _checked)(file, rig_path, result)
    except (UnusableInput, CheckFailed) as error:
        write_json(json_path, result | {"why": str(error)})
        raise
    title = f"{file}: {result['arch']} for {result['domain']}, as promised"
    print_table(title, ["", ""], rows)
    write_json(json_path, result | {"ok": True})


def _checked(file: Path, rig_path: Path | None, result: dict[str, Any]) -> list[list[str]]:
    """The table of a package that passes; `result` is filled with what is known by then."""
    from runtime.replay import Replay
    from wakedeploy.api.predictors import load

    predictor = load(file)
    manifest = predictor.manifest
    exported = manifest.parity.model_dump(include={"max_abs", "max_rel", "steps"})
    result |= {"arch": manifest.arch, "trainable": manifest.trainable, "parity": exported}
    result |= {"domain": manifest.domain}
    with progress(f"Checking {file}", 1):
        replayed = predictor.check(rig_path)
    assert isinstance(replayed, Replay), "a file is a package"
    fits = [_fit(manifest, rig_path)] if rig_path else []
    difference = replayed.difference
    here = {"max_rel": difference.max_rel, "max_abs": difference.max_abs, "steps": replayed.steps}
    result |= {"replay": here | {"limited": replayed.limited}}
    return [
        ["manifest, hash and graph", "agree"],
        ["reset, two runners, a batch", "keep apart"],
        ["example rollout here", f"{difference.max_rel:.1e} over {replayed.steps} steps"],
        ["parity when exported", f"{exported['max_rel']:.1e} over {exported['steps']} steps"],
        ["limit", f"{manifest.parity.limit:.1e}"],
        *([f"possible {c.name}", f"{c.low:.3g} to {c.high:.3g} {c.unit}"] for c in manifest.force),
        ["at a limit, driven over its ranges", f"{100 * replayed.limited:.1f} % of the steps"],
        *_filters(manifest),
        *fits,
    ]


def _checked_c(path: Path, rig_path: Path | None, result: dict[str, Any]) -> list[list[str]]:
    """The same of a folder of C."""
    from runtime.compiled.folder import read_c_folder
    from runtime.compiled.proof import proved
    from wakedeploy.cli.export_c import json_of_c, rounding_rows

    folder = read_c_folder(path)
    manifest, document = folder.manifest, folder.document
    result |= {"arch": manifest.arch, "trainable": manifest.trainable, "domain": manifest.domain}
    with progress(f"Compiling and running {document.name}_test.c", 1):
        here = proved(folder)
    if rig_path:
        _require_fit(manifest, rig_path)
    fits = [_fit(manifest, rig_path)] if rig_path else []
    proofs = [proof.model_dump(mode="json") for proof in here.proofs]
    result |= {"c": json_of_c(folder), "here": proofs, "steps": here.steps}
    return [
        ["manifest, hashes of its .c, .h and test", "agree"],
        *([f"here, {p.flags}", f"{p.max_rel:.1e} over {here.steps} steps"] for p in here.proofs),
        ["reference", document.reference.rstrip(",")],
        ["limit", f"{document.limit:.1e}"],
        ["weights", document.weights],
        *rounding_rows(folder),
        *([f"possible {c.name}", f"{c.low:.3g} to {c.high:.3g} {c.unit}"] for c in manifest.force),
        *_filters(manifest),
        *fits,
    ]


def _filters(manifest: "Manifest") -> list[list[str]]:
    """What the loop has to do to observations before each step."""
    return [[f"filter {c.name} likewise", c.filtered] for c in manifest.observation if c.filtered]


def _require_fit(manifest: "Manifest", rig_path: Path) -> None:
    """UnusableInput where this rig's loop cannot fly it."""
    from runtime.loop.loop import require_wait
    from runtime.request import require_fit
    from wakedeploy.rig.file import read_rig

    rig = read_rig(rig_path)
    require_fit(manifest, rig)
    require_wait(rig)


def _fit(manifest: "Manifest", rig_path: Path) -> list[str]:
    """What a package is said to be for that fits the rig's loop."""
    return [f"rate, channels, forces and lead of {rig_path}", f"fit, {manifest.lead_s:g} s ahead"]
