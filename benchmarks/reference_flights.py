"""What reference flights teach: known spreads, and a form error that is evident no more.

`python -m benchmarks.reference_flights --out FOLDER [--sets N] [--record]` flies N sets of seven
flights with thrust, battery and bias of their own and one odd flight, and one gantry whose jet has
another form: seven flights to learn from, five to judge. `--record` writes
`docs/records/reference-flights.json`.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.form_error.cases import Case, flights_of, fly, jet_of_case
from benchmarks.records import FOLDER, write
from wakedeploy.core.files import json_text, write_text_whole
from wakedeploy.core.rig import Effect, EffectParameter, Rig
from wakedeploy.domains.gantry import record
from wakedeploy.gap.evidence.expected_gains import promises
from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.systems.gantry.flight import Flight, flight_from_log, read_flights
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.reference.corrected import corrected, form_force_n
from wakedeploy.gap.systems.gantry.reference.learning import Reference, learn
from wakedeploy.gap.systems.gantry.search.expression_terms import TERMS
from wakedeploy.gap.systems.gantry.search.naming import fitted_base, with_terms
from wakedeploy.gap.systems.gantry.search.refitting import refitted
from wakedeploy.physics.constants import with_constants
from wakedeploy.rig.file import default_rig, read_rig

FLIGHTS, SECONDS = 7, 20.0
SPREADS = {"thrust.sufferer.scale": 0.012, "battery-sag": 0.0005, "range.bias_m": 0.002}
MEAN_SAG_PER_S = 0.0015
ODD_FLIGHT, ODD_M = 3, 0.03
_MOST_TRIES = 5
LEARNED = "learned.toml"
_JUDGED = 5
_FIRST_SEED = 7300
FORM = Case(4103, "bent", 0.028)


def spread_set(seed: int) -> dict[str, Any]:
    """One set of known spreads: what was flown, and what was learned of it."""
    rig, rng = default_rig(), np.random.default_rng([seed, 21])
    deviations = {name: sd * rng.standard_normal(FLIGHTS) for name, sd in SPREADS.items()}
    deviations["battery-sag"] = np.maximum(deviations["battery-sag"] + MEAN_SAG_PER_S, 0.0)
    deviations["range.bias_m"][ODD_FLIGHT] += ODD_M
    flights = [
        _flown(rig, {n: v[i] for n, v in deviations.items()}, seed, i) for i in range(FLIGHTS)
    ]
    learned = learn(rig, flights)
    return {
        "seed": seed,
        "odd": [[o.flight, o.quantity.name, o.away, o.p_value] for o in learned.odd],
        "quantities": [_quantity(learned, i, deviations) for i in range(len(learned.variations))],
        "named": list(learned.fit.hypothesis),
    }


def _flown(rig: Rig, deviations: Mapping[str, float], seed: int, number: int) -> Flight:
    truth = with_constants(
        rig, {"thrust.sufferer.scale": 1.0 + deviations["thrust.sufferer.scale"]}
    )
    hidden = (
        Effect(
            name="range-bias",
            parameters={"bias_m": EffectParameter(value=deviations["range.bias_m"], unit="m")},
        ),
        Effect(
            name="battery-sag",
            parameters={"sag_per_s": EffectParameter(value=deviations["battery-sag"], unit="1/s")},
        ),
    )
    truth = truth.model_copy(update={"effect": hidden})
    for again in range(_MOST_TRIES):
        chance = 100 * seed + number + 10 * again
        log = record(truth, seconds=SECONDS, seed=chance, model_rig=rig).without_truth()
        if len(log) / log.rate_hz > SECONDS:  # one that came down early is flown again
            break
    return flight_from_log(log, rig, f"flight{number}.mcap")


def _quantity(
    learned: Reference, place: int, deviations: Mapping[str, np.typing.NDArray[np.float64]]
) -> dict[str, Any]:
    """A quantity's variation as it was and as it was found, and how its errors compare."""
    variation = learned.variations[place]
    true = deviations[variation.quantity.name]
    kept = list(learned.kept)
    off = variation.values - true
    off = (off - off[kept].mean())[kept] / np.hypot(variation.errors[kept], 1e-12)
    return {
        "quantity": variation.quantity.name,
        "true_sd": float(true[kept].std(ddof=1)),
        "sd": variation.between.sd,
        "low": variation.between.low,
        "high": variation.between.high,
        "rms_error_in_standard_errors": float(np.sqrt(np.mean(off**2))),
    }


def form_learned(out: Path) -> dict[str, Any]:
    """A gantry of another form: what seven flights teach, and the rig file that they make."""
    rig = default_rig()
    learned = learn(rig, read_flights(flights_of(FORM, out / "flights"), rig))
    corrected(learned).write(out / LEARNED)
    jet = jet_of_case(FORM, rig)
    return {
        "misfit_share": jet.misfit_share,
        "misfit_n": jet.misfit_n,
        "learned_form_n": form_force_n(learned),
        "named": list(learned.fit.hypothesis),
        "odd": len(learned.odd),
    }


def form_judged(rig: Rig) -> dict[str, Any]:
    """Five further flights of it: how evident its form is under a rig file."""
    believed = default_rig()
    logs = [fly(FORM, believed, 100 * FORM.seed + 50 + i) for i in range(_JUDGED)]
    flights = [flight_from_log(log.without_truth(), rig, f"{i}") for i, log in enumerate(logs)]
    return _evident(rig, flights)


def _evident(rig: Rig, flights: Sequence[Flight]) -> dict[str, Any]:
    """What the form gains beyond the rig file's, and the best term on top of the file's own."""
    model, base = fitted_base(with_terms(GantryModel(_exact(rig), flights)))
    free = GantryModel(rig, model.flights, TERMS)
    start = [dict(zip(base.names, base.theta, strict=True)).get(f.name, f.neutral)
             for f in free.free(())]  # fmt: skip
    _, formed = refitted(free, fit(free, (), range(free.episodes), np.array(start)))
    names = list(TERMS)
    gains = promises(model, base, names)
    best = int(gains.argmax())
    return {
        "form_nats": formed.objective - base.objective,
        "best_term": names[best],
        "best_term_nats": float(gains[best]),
        "forecast_m": _forecast_m(model, base),
    }


def _exact(rig: Rig) -> Rig:
    """The rig with its form as stated, and no freedom about it."""
    known = {name: [size, 1e-6] for name, (size, _) in rig.discrepancy.fitted.items()}
    if known:
        return rig.changed(discrepancy={"fitted": known})
    return rig.changed(discrepancy={"wake": 0.0, "friction": 0.0})


def _forecast_m(model: GantryModel, fitted: Fit) -> float:
    """Root mean square [m] of the error a second ahead."""
    errors = []
    for episode in range(model.episodes):
        ahead = model.forecasts(fitted, episode, (1.0,))
        errors.append(ahead.measured_m[0] - ahead.forecast_m[0])
    found = np.concatenate(errors)
    return float(np.sqrt(np.nanmean(found**2)))


def parts(out: Path, sets: int) -> dict[str, Callable[[], dict[str, Any]]]:
    """What there is to do, in order, by name."""
    each: dict[str, Callable[[], dict[str, Any]]] = {
        "form": partial(form_learned, out),
        "before": lambda: form_judged(default_rig()),
        "after": lambda: form_judged(read_rig(out / LEARNED)),
    }
    return each | {f"set{i}": partial(spread_set, _FIRST_SEED + i) for i in range(sets)}


@click.command()
@click.option("--out", type=click.Path(path_type=Path), required=True)
@click.option("--sets", default=4, help="of known spreads")
@click.option("--most", default=100, help="parts in this run; the folder keeps what is done")
@click.option("--record", "is_kept", is_flag=True, help="write docs/records/reference-flights.json")
def main(out: Path, sets: int, most: int, is_kept: bool) -> None:
    """Fly, learn, and print."""
    out.mkdir(parents=True, exist_ok=True)
    todo = parts(out, sets)
    remaining = [name for name in todo if not (out / f"{name}.json").is_file()]
    for name in remaining[:most]:
        result = todo[name]()
        write_text_whole(out / f"{name}.json", json_text(result))
        click.echo(f"{name}: {json_text(result)}")
    if is_kept and len(remaining) <= most:
        done = {name: json.loads((out / f"{name}.json").read_text()) for name in todo}
        write(FOLDER / "reference-flights.json", done)


if __name__ == "__main__":
    main()
