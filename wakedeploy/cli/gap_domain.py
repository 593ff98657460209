"""`wakedeploy gap domain`: the gap workflow on recordings and simulations other than the gantry."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from wakedeploy.cli.log_lines import stages
from wakedeploy.cli.names import OneName
from wakedeploy.cli.output import json_option, print_table
from wakedeploy.cli.recordings import recordings_folder
from wakedeploy.core.discovery import offers
from wakedeploy.gap.systems.domains import KIND

if TYPE_CHECKING:
    from wakedeploy.gap.search.artefacts import Result


@click.command("domain")
@click.argument(
    "name",
    type=OneName("gap domain", lambda: tuple(offers(KIND))),
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

    NAME is motor, fish, quadrotor, downwash, or what another package adds. Without PATH recordings
    are looked for in $WAKEDEPLOY_DATA/NAME. downwash flies its own simulation and takes none.

    \b
    Example:
        wakedeploy gap domain motor esc_test --out runs/motor
        wakedeploy gap domain downwash --out runs/downwash
    """
    from wakedeploy.gap.report.system_page import write_page
    from wakedeploy.gap.systems.domains.domain import gap_domain
    from wakedeploy.gap.workflow import concluded

    chosen = gap_domain(name)
    if path is None and not chosen.is_simulated:
        folder = recordings_folder(None)
        path = None if folder is None else folder / name
    model = chosen.opened(path)
    with stages() as progress:
        result = chosen.completed(model, concluded(model, progress), progress)
        result.write(out / "domain.json")
        if json_path:
            result.write(json_path)
        progress("drawing the report")
        page = write_page(result, out)
    _print(name, result)
    if result.far is not None:
        _print(f"{name}, where no wake is", result.far)
    click.echo(f"Report: {page}")


def _print(title: str, result: "Result") -> None:
    from wakedeploy.gap.systems.answers.halves import repeated_sentences

    found = ", ".join(e.name for e in result.effects) or "nothing"
    if result.rivals:
        found = f"one of {' or '.join(result.rivals)}"
    click.echo(f"{title}: {result.verdict}: {found}")
    print_table(
        "parameters",
        ["parameter", "value", "low", "high", "unit"],
        [
            [n, *(f"{v:.4g}" for v in (p.value, p.low, p.high)), p.unit]
            for n, p in result.parameters.items()
        ],
    )
    print_table(
        f"each alone, threshold {result.threshold_nats:.1f} nats",
        ["effect", "held-out nats"],
        [[candidate.name, f"{candidate.gain_nats:.1f}"] for candidate in result.rounds[0].ranking],
    )
    print_table(
        "residual on sealed episodes",
        ["channel", "before", "after", "unit"],
        [[n, f"{g.before:.4g}", f"{g.after:.4g}", g.unit] for n, g in result.gap.items()],
    )
    for sentence in repeated_sentences(result):
        click.echo(sentence)
