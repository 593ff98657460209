"""`wakedeploy rig`: start a rig file, and check one."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from wakedeploy.cli.groups import Group
from wakedeploy.cli.output import json_option, print_table, write_json
from wakedeploy.core.errors import UnusableInput


@click.group(cls=Group)
def command() -> None:
    """Start a rig file (a gantry's constants), or check one.

    \b
    Example:
        wakedeploy rig init rig.toml
        wakedeploy rig show rig.toml
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
