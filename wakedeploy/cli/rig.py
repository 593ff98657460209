"""`wakedeploy rig`: start a rig file, check one, and serve a virtual gantry that has it."""

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from wakedeploy.cli.groups import Group
from wakedeploy.cli.output import json_option, print_table, write_json
from wakedeploy.core.errors import UnusableInput


@click.group(cls=Group)
def command() -> None:
    """Start a rig file (a gantry's constants), check one, or serve a virtual gantry at a port.

    \b
    Example:
        wakedeploy rig init rig.toml
        wakedeploy rig show rig.toml
        wakedeploy rig virtual rig.toml --out desk
    """


@command.command()
@click.argument("path", type=click.Path(dir_okay=False, path_type=Path), default="rig.toml")
@click.option("--force", is_flag=True, help="Replace an existing file.")
def init(path: Path, force: bool) -> None:
    """Write the default rig, with its comments, to PATH.

    \b
    Example:
        wakedeploy rig init rig.toml
    """
    from wakedeploy.core.files import write_text_whole
    from wakedeploy.rig.file import default_rig_text

    if path.exists() and not force:
        raise UnusableInput(f"{path}: exists already; give another name, or --force to replace it.")
    write_text_whole(path, default_rig_text())
    click.echo(
        f"Wrote {path}: edit what differs on your gantry, then `wakedeploy rig show {path}`."
    )


@command.command()
@click.argument("path", type=click.Path(dir_okay=False, path_type=Path), required=False)
@json_option
def show(path: Path | None, json_path: Path | None) -> None:
    """Check the rig file PATH and print constants and effects; without PATH, the default rig's.

    \b
    Example:
        wakedeploy rig show rig.toml
    """
    from wakedeploy.physics.effects.chain import Chain, default_lead_s
    from wakedeploy.rig.file import default_rig, read_rig

    rig = read_rig(path) if path else default_rig()
    constants = _flat(rig.model_dump(mode="json", by_alias=True))
    chain = Chain.of(rig)
    constants |= {name: f"{value:g}" for name, value in chain.values.items()}
    units = {f"{e.name}.{p.name}": p.unit for e, _ in chain.parts for p in e.parameters}
    rows = [[n, v, _unit(n, units), _spread(rig, n)] for n, v in constants.items()]
    print_table(f"{path or 'default rig'}", ["constant", "value", "unit", "spread"], rows)
    click.echo(f"Lead that fits this rig: {default_lead_s(rig):g} s.")
    write_json(json_path, {"rig": rig.model_dump(mode="json", by_alias=True)})


@command.command()
@click.argument("path", type=click.Path(dir_okay=False, path_type=Path), required=False)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    default="desk",
    show_default=True,
    help="Folder for the port, uno, and the range sensor's socket, range.sock.",
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of its noise."
)
@click.option("--firmware", is_flag=True, help="The compiled sketch on a simulated UNO.")
def virtual(path: Path | None, out: Path, seed: int, firmware: bool) -> None:
    """Serve the virtual gantry PATH at a port, in real time, until Ctrl-C.

    To another terminal it is a rig: every command that takes --port opens it. It stands there
    between flights, as a rig does. Without PATH it is the default rig.

    \b
    Example:
        wakedeploy rig virtual rig.toml --out desk
        wakedeploy run-gantry --baseline --trust-curve \\
            --port desk/uno --range-socket desk/range.sock
    """
    from runtime.virtual.served import PORT, RANGES, served
    from wakedeploy.core.errors import CheckFailed
    from wakedeploy.core.interruption import interruptible
    from wakedeploy.rig.file import default_rig, read_rig

    rig = read_rig(path) if path else default_rig()
    with interruptible(), served(rig, out, seed=seed, firmware=firmware) as gantry:
        place = ("--port", str(out / PORT), "--range-socket", str(out / RANGES))
        click.echo(f"The virtual gantry answers until Ctrl-C: {shlex.join(place)}")
        gantry.wait()
    raise CheckFailed(
        "The virtual gantry's process has ended. Its message, if it had one, stands above; the "
        "same command starts it again."
    )


def _flat(table: dict[str, Any], above: str = "") -> dict[str, str]:
    """Nested tables as dotted names."""
    flat: dict[str, str] = {}
    for name, value in table.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{above}{name}.")
        else:
            flat[f"{above}{name}"] = _text(value)
    return flat


def _text(value: Any) -> str:
    if isinstance(value, list):
        texts = (entry["name"] if isinstance(entry, dict) else f"{entry:g}" for entry in value)
        return ", ".join(texts) or "none"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _unit(name: str, of_effects: Mapping[str, str]) -> str:
    """The unit of an effect's parameter, or that in a constant's name; "" for pure numbers."""
    from wakedeploy.core.units import unit_of

    unit = of_effects.get(name) or unit_of(name.rpartition(".")[2]) or ""
    return "" if unit == "1" else unit


def _spread(rig: Any, name: str) -> str:
    known = rig.calibration.get(name)
    return f"± {known.spread:g}" if known and known.spread is not None else ""
