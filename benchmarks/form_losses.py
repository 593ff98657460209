"""What each library effect loses to the model's own form, on simulated flights of the default rig.

`python -m benchmarks.form_losses` writes `docs/records/form-losses.json`: per effect, at its
plausible size, the nats that it gains on the flights, and the share of what it would gain were the
form of wake and friction exact.
"""

from typing import Any

import click

from benchmarks.records import FOLDER, write
from wakedeploy.domains.gantry import record
from wakedeploy.gap.evidence.separation import gain_nats, gather, lost_to_form
from wakedeploy.gap.systems.gantry.flight import flight_from_log
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.planning.plan import plausible_size
from wakedeploy.gap.systems.gantry.search.naming import fitted_base
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.rig.file import default_rig

FLIGHTS, SECONDS = 5, 20.0
_FIRST_SEED = 8200
RECORD = "form-losses.json"


def losses() -> list[dict[str, Any]]:
    """A row per effect, those that lose most first."""
    rig = default_rig()
    logs = [record(rig, seconds=SECONDS, seed=_FIRST_SEED + i) for i in range(FLIGHTS)]
    flights = [flight_from_log(log.without_truth(), rig, f"{i}") for i, log in enumerate(logs)]
    model, base = fitted_base(GantryModel(rig, flights))
    evidence = gather(model, base, tuple(LIBRARY), {n: plausible_size(rig, n) for n in LIBRARY})
    lost, gained = lost_to_form(evidence, base.free), gain_nats(evidence)
    rows = [
        {"effect": name, "gain_nats": float(nats), "lost": float(share)}
        for name, nats, share in zip(evidence.names, gained, lost, strict=True)
    ]
    return sorted(rows, key=lambda row: -float(row["lost"]))


@click.command()
def main() -> None:
    """Write the record, and print what loses most."""
    rows = losses()
    write(FOLDER / RECORD, {"flights": FLIGHTS, "seconds": SECONDS, "rows": rows})
    for row in rows:
        click.echo(f"{row['effect']:<26} {100 * row['lost']:5.0f} %  {row['gain_nats']:8.1f} nats")


if __name__ == "__main__":
    main()
