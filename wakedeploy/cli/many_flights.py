"""`wakedeploy run-gantry --flights`: many flights, summed up as means with their errors."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.output import print_table, stage_bars, write_json
from wakedeploy.core.errors import CheckFailed, UnusableInput

if TYPE_CHECKING:
    from runtime.flights import Flight, Mean

_NAMES = {"pid": "PID alone", "feedforward": "PID and feedforward"}


def fly_and_tell(asked: dict[str, Any], flights: int, workers: int, json_path: Path | None) -> None:
    """Fly them all, print mean ± standard error; CheckFailed when one did not end whole."""
    if asked.get("port") or asked.get("wall_clock"):
        raise UnusableInput("--flights flies in simulated time: give --virtual, no --wall-clock.")
    if asked.get("watch_gap"):
        raise UnusableInput("--watch-gap belongs to a single flight; leave --flights away.")
    from wakedeploy.api.flights import fly

    log = asked["log"]
    with stage_bars() as bars:
        made = fly(**asked, flights=flights, record=log is not None, workers=workers, progress=bars)
    flown = made.all_flown
    result = summary(flown)
    _tell(result)
    if log is not None:
        click.echo(f"Recorded in {log}.")
    write_json(json_path, result)
    if result["ended_early"]:
        early = result["ended_early"][0]
        raise CheckFailed(
            f"{len(result['ended_early'])} of {len(flown)} flights did not end whole, the first "
            f"with seed {early['seed']} ({early['ended']}); fly it alone: --seed {early['seed']}."
        )


def summary(flown: "Sequence[Flight]") -> dict[str, Any]:
    """Means with standard errors [mm], each flight, and those that ended early."""
    from runtime.flights import FEEDFORWARD, WHOLE, gain_of, mean_of

    controllers = list(dict.fromkeys(flight.controller for flight in flown))
    result: dict[str, Any] = {
        "rmse_mm": {name: _as_json(mean_of(flown, name)) for name in controllers},
        "flights": [
            {
                "controller": f.controller,
                "seed": f.seed,
                "ended": f.ended,
                "rmse_mm": 1e3 * f.rmse_m,
            }
            for f in flown
        ],
        "ended_early": [
            {"controller": f.controller, "seed": f.seed, "ended": f.ended}
            for f in flown
            if f.ended != WHOLE
        ],
    }
    if FEEDFORWARD in controllers:
        result["gain_mm"] = _as_json(gain_of(flown))
    return result


def _as_json(mean: "Mean") -> dict[str, float | int | None]:
    error_mm = 1e3 * mean.standard_error_m
    return {
        "mean": 1e3 * mean.value_m if mean.flights else None,
        "standard_error": error_mm if error_mm == error_mm else None,
        "flights": mean.flights,
    }


def _tell(result: dict[str, Any]) -> None:
    rows = [
        [_NAMES[name], with_error(mean), str(mean["flights"])]
        for name, mean in result["rmse_mm"].items()
    ]
    print_table("Altitude RMSE, mean ± standard error", ["", "mm", "flights"], rows)
    if gain := result.get("gain_mm"):
        click.echo(f"Feedforward gains {with_error(gain)} mm, flight by flight.")


def with_error(mean: dict[str, Any]) -> str:
    """A mean with its standard error [mm], as far as they are known."""
    if mean["mean"] is None:
        return "-"
    error = mean["standard_error"]
    return f"{mean['mean']:.1f}" if error is None else f"{mean['mean']:.1f} ± {error:.1f}"
