"""`wakedeploy gap domain`: the gap workflow on recordings and simulations other than the gantry."""

from pathlib import Path
from typing import Any

import click

from wakedeploy.cli.log_lines import stages
from wakedeploy.cli.output import json_option, print_table, write_json
from wakedeploy.cli.recordings import recordings_folder


@click.command("domain")
@click.argument(
    "name",
    type=click.Choice(["motor", "fish", "quadrotor", "downwash"], case_sensitive=False),
)
@click.argument("path", type=click.Path(path_type=Path), required=False)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    required=True,
    help="Folder for domain.json, report.html and figures.",
)
@json_option
def domain(
    name: str,
    path: Path | None,
    out: Path,
    json_path: Path | None,
) -> None:
    """Find, name and show what a domain's baseline lacks; PATH holds its recordings.

    Without PATH they are looked for in $WAKEDEPLOY_DATA/NAME. downwash flies its own simulation and
    takes none.

    \b
    Example:
        wakedeploy gap domain motor esc_test --out runs/motor
        wakedeploy gap domain downwash --out runs/downwash
    """
    from wakedeploy.gap.report.system_page import write_page
    from wakedeploy.gap.search.rounds import concluded
    from wakedeploy.gap.systems import further, open_domain

    if path is None and name != "downwash":
        folder = recordings_folder(None)
        path = None if folder is None else folder / name
    model = open_domain(name, path)
    with stages() as progress:
        document = concluded(model, progress) | further(name, model, progress)
        write_json(out / "domain.json", document)
        if json_path:
            write_json(json_path, document)
        progress("drawing the report")
        page = write_page(document, out)
    _print(name, document)
    if "far" in document:
        _print(f"{name}, where no wake is", document["far"])
    click.echo(f"Report: {page}")


def _print(title: str, document: dict[str, Any]) -> None:
    found = ", ".join(e["name"] for e in document["effects"]) or "nothing"
    if document["class"]:
        found = f"one of {' or '.join(document['class'])}"
    click.echo(f"{title}: {document['verdict']}: {found}")
    print_table(
        "parameters",
        ["parameter", "value", "low", "high", "unit"],
        [
            [n, *(f"{p[k]:.4g}" for k in ("value", "low", "high")), p["unit"]]
            for n, p in document["parameters"].items()
        ],
    )
    first = document["rounds"][0]["ranking"]
    print_table(
        f"each alone, threshold {document['threshold_nats']:.1f} nats",
        ["effect", "held-out nats"],
        [[c["name"], f"{c['gain_nats']:.1f}"] for c in first],
    )
    print_table(
        "residual on sealed episodes",
        ["channel", "before", "after", "unit"],
        [
            [n, f"{g['before']:.4g}", f"{g['after']:.4g}", g["unit"]]
            for n, g in document["gap"].items()
        ],
    )
