"""`wakedeploy gap reference`: what ordinary flights show of a rig beyond its file."""

from pathlib import Path

import click

from wakedeploy.cli.many_files import Many
from wakedeploy.cli.output import Written

_FILE = click.Path(path_type=Path, dir_okay=False)


@click.command("reference", cls=Many)
@click.option(
    "--rig",
    "rig_path",
    type=_FILE,
    required=True,
    help="The rig file that the flights were flown with.",
)
@click.option(
    "--measured",
    type=_FILE,
    multiple=True,
    required=True,
    help="Run logs of four or more ordinary flights, best seven.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    required=True,
    help="Folder for reference.json and the new rig.toml.",
)
@click.option("--json", "json_path", type=Written(), help="Also write the result as JSON here.")
def reference(
    rig_path: Path, measured: tuple[Path, ...], out: Path, json_path: Path | None
) -> None:
    """Learn from ordinary flights: repeatability, the jet's axis, the wake's map.

    Says which flight is unlike the others. OUT/rig.toml lets each flight have its own thrust,
    battery and bias, as far as they vary; the old rig file stays.

    \b
    Example:
        wakedeploy gap reference --rig rig.toml --measured ordinary*.mcap --out reference
        wakedeploy gap close --rig reference/rig.toml --measured flight*.mcap --out gap
    """  # fmt: skip
    from wakedeploy.cli.log_lines import stages
    from wakedeploy.cli.output import warn, write_json
    from wakedeploy.gap.systems.gantry.flight import usable_flights
    from wakedeploy.gap.systems.gantry.reference.corrected import corrected
    from wakedeploy.gap.systems.gantry.reference.learning import learn
    from wakedeploy.gap.systems.gantry.reference.summary import as_json
    from wakedeploy.rig.file import read_rig

    rig = read_rig(rig_path)
    flights, unflown = usable_flights(measured, rig)
    for log in unflown:
        warn(log.sentence)
    with stages() as progress:
        learned = learn(rig, flights, progress)
    content = as_json(learned) | {"unflown": [log.model_dump() for log in unflown]}
    new = corrected(learned)
    out.mkdir(parents=True, exist_ok=True)
    write_json(out / "reference.json", content)
    new.write(out / "rig.toml")
    for sentence in content["sentences"]:
        click.echo(sentence)
    click.echo(f"Wrote {out / 'rig.toml'}: give it as --rig from now on.")
    write_json(json_path, content)
