"""How much gain a rig shows when nothing is missing: the thresholds, simulated and cached.

In: a rig. Out: `Thresholds` that are exceeded together in one case of twenty by closed-loop flights
without any effect, but with constants and forms off by as much as the rig file allows. Ordinary
calibration error gives wrong effects many nats; so does looking at thirty effects at once. A
threshold therefore belongs to a rig and cannot be chosen.
"""

import hashlib
import json
import os
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from importlib.resources import files
from pathlib import Path

import numpy as np

from wakedeploy.core.discovery import EFFECTS, offers
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import (
    append_json_line,
    json_of,
    read_json_lines,
    text_of,
    write_text_whole,
)
from wakedeploy.core.parallel import parallel_map
from wakedeploy.core.rig import Effect, EffectParameter, Rig
from wakedeploy.domains.gantry import record
from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.evidence.whiteness import whiteness
from wakedeploy.gap.search.artefacts import Place
from wakedeploy.gap.systems.gantry.discrepancy import FormedWorld, drawn, free_terms
from wakedeploy.gap.systems.gantry.flight import flight_from_log
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.rules import RULES
from wakedeploy.gap.systems.gantry.search.expression_terms import is_wave_in_time
from wakedeploy.gap.systems.gantry.search.expressions import SEARCHED, search
from wakedeploy.gap.systems.gantry.search.naming import (
    fitted_base,
    ranked_by_own_motion,
    with_terms,
)
from wakedeploy.gap.systems.gantry.search.outcome import Thresholds
from wakedeploy.gap.systems.gantry.search.places import find_places
from wakedeploy.gap.systems.gantry.search.refitting import expressed_by_own_motion
from wakedeploy.gap.systems.gantry.varying import of_one_flight
from wakedeploy.physics.constants import constants_of, spreads_of, with_constants
from wakedeploy.physics.effects import LIBRARY, replacing
from wakedeploy.physics.effects.chain import setting_of

SETS = 48
FLIGHTS, SECONDS = 5, 20.0
_FIRST_SEED = 600_000_000
_INTERVAL_SD = 1.645  # half of a 90 % interval
_LEAST_RANKED_NATS = 2.0  # even what would be far below a threshold is ranked to the end
VERSION = 12  # of what is simulated; thresholds of another version are not used
LEAST = Thresholds(3.0, 3.0, 4.0, 40.0, 0.005, 0.005, 0.001)
_NAMING = ("effect_nats", "expression_nats", "wave_nats", "whiteness")


@dataclass(frozen=True)
class NullSet:
    """What one set of flights without any missing effect reached."""

    effect_nats: float
    effect: str
    expression_nats: float
    wave_nats: float
    whiteness: float
    places: dict[str, float]  # the largest residual at a place, by channel


def thresholds_for(
    rig: Rig,
    *,
    workers: int = 2,
    progress: Callable[[int, int], None] | None = None,
) -> Thresholds:
    """The rig's thresholds: shipped, cached, or simulated now (minutes; `progress(done, of)`).

    Simulated sets are kept as they finish: a stopped simulation goes on where it was.
    """
    known = known_thresholds(rig)
    if known is None:
        path = _cache_path(rig)
        path.parent.mkdir(parents=True, exist_ok=True)
        done = path.with_suffix(".jsonl")
        known = quantiles(simulate(rig, workers=workers, kept=done, progress=progress))
        write_text_whole(path, json.dumps(asdict(known), indent=1))
        done.unlink(missing_ok=True)
    return known


def searched_with(rig: Rig) -> str:
    """A hash of what a search of this rig may fit: its form's terms, the library's parameters.

    Shipped thresholds have it beside them. If it changes, as with another size of a form term, a
    new `VERSION` and new simulations are needed.
    """
    terms = [(f.name, f.neutral, f.prior_sd) for f in free_terms(rig)]
    effects = [(e.name, [asdict(p) for p in e.parameters]) for e in LIBRARY.values()]
    return hashlib.sha256(repr((terms, effects)).encode()).hexdigest()


def known_thresholds(rig: Rig) -> Thresholds | None:
    """The rig's thresholds if they are shipped or cached; nothing is simulated."""
    known = _shipped().get(rig.sha256) or _cached(rig)
    return None if known is None else Thresholds(**known)


def simulate(
    rig: Rig,
    *,
    sets: int = SETS,
    workers: int = 2,
    first_seed: int = _FIRST_SEED,
    kept: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> list[NullSet]:
    """Fly and search `sets` times; deterministic by seed.

    Each set is appended to the file `kept` when it is done; a set in the file is not repeated.
    """
    seeds = [first_seed + 1000 * i for i in range(sets)]
    results = _known_sets(kept) if kept is not None else {}
    remaining = [seed for seed in seeds if seed not in results]

    def keep(job: tuple[str, int], result: NullSet) -> None:
        results[job[1]] = result
        if kept is not None:
            append_json_line(kept, {"seed": job[1], **asdict(result)})
        if progress is not None:
            progress(len(results), sets)

    jobs = [(rig.text, seed) for seed in remaining]
    parallel_map(_null_set, jobs, workers=workers, on_done=keep)
    return [results[seed] for seed in seeds]


def _known_sets(path: Path) -> dict[int, NullSet]:
    """The sets that an interrupted simulation has kept, by seed."""
    known = {}
    for line in read_json_lines(path):
        seed = line.pop("seed", None)
        if seed is not None and set(line) == {f.name for f in fields(NullSet)}:
            known[int(seed)] = NullSet(**line)
    return known


def quantiles(null: Sequence[NullSet]) -> Thresholds:
    """The lowest equal quantile of the four that together one set in twenty exceeds.

    It is smoothed by Gumbel's distribution of maxima: few sets determine its two moments better
    than their own largest values.
    """
    if len(null) < 10:
        raise UnusableInput(f"{len(null)} simulated sets say nothing about one in twenty; use 10.")
    columns = np.array([[getattr(n, name) for name in _NAMING] for n in null])  # (S, 4)
    least = np.array([getattr(LEAST, name) for name in _NAMING])
    limits = least
    for share in np.linspace(0.90, 0.999, 200):
        limits = np.maximum([_gumbel(column, share) for column in columns.T], least)
        if (columns > limits).any(axis=1).mean() <= RULES.false_alarms:
            break
    residuals = {
        channel: _gumbel(
            np.array([n.places[channel] for n in null]), 1.0 - RULES.false_alarms / 3.0
        )
        for channel in LEAST.places
    }
    floors = [max(residuals[channel], least) for channel, least in LEAST.places.items()]
    return Thresholds(*(float(limit) for limit in limits), *floors)


def miscalibrated(rig: Rig, rng: np.random.Generator) -> Rig:
    """A truth that the rig file describes to within its spreads, drawn at random.

    Delays are off by an absolute value: a negative delay is no delay. Effects of the rig file are
    off by what their intervals allow.
    """
    values, spreads = constants_of(rig), spreads_of(rig)
    drawn = {n: values[n] + s * float(rng.standard_normal()) for n, s in spreads.items()}
    for name in drawn:
        if name.startswith(("rail.", "spool.", "wake.")):
            drawn[name] = max(drawn[name], 0.1 * values[name])
    held_n = drawn.get("rail.stiction_n", values["rail.stiction_n"])
    drawn["rail.stiction_n"] = max(held_n, drawn.get("rail.coulomb_n", 0.0))
    truth = with_constants(rig, drawn)
    hidden = [
        _replaced("range.bias_m", drawn.get("range.bias_m", 0.0)),
        _replaced("range.delay_s", abs(drawn.get("range.delay_s", 0.0))),
        _replaced("command.delay_s", abs(drawn.get("command.delay_s", 0.0))),
    ]
    taken = {entry.name for entry in rig.effect}
    added = tuple(entry for entry in hidden if entry.name not in taken)
    effects = tuple(_drawn(effect, rng) for effect in truth.effect)
    return truth.model_copy(update={"effect": (*effects, *added)})


def _drawn(effect: Effect, rng: np.random.Generator) -> Effect:
    """An effect of a rig file, its parameters drawn from their intervals, within the library's."""
    stated = LIBRARY[effect.name].parameters if effect.name in LIBRARY else ()
    bounds = {p.name: (p.low, p.high) for p in stated}
    drawn = {}
    for name, known in effect.parameters.items():
        value = known.value
        if known.low is not None and known.high is not None:
            value += (known.high - known.low) / (2.0 * _INTERVAL_SD) * float(rng.standard_normal())
        low, high = bounds.get(name, (-np.inf, np.inf))
        drawn[name] = known.model_copy(update={"value": float(np.clip(value, low, high))})
    return effect.model_copy(update={"parameters": drawn})


def _replaced(constant: str, value: float) -> Effect:
    """The effect that gives this value to a constant which no section of a rig file has."""
    name, _, parameter = replacing(constant)[0].partition(".")
    unit = next(p.unit for p in LIBRARY[name].parameters if p.name == parameter)
    return Effect(name=name, parameters={parameter: EffectParameter(value=value, unit=unit)})


def _null_set(job: tuple[str, int]) -> NullSet:
    from wakedeploy.rig.file import parse_rig

    text, seed = job
    rig = parse_rig(text)
    truth = miscalibrated(rig, np.random.default_rng([seed, 7]))
    form = drawn(rig, np.random.default_rng([seed, 11]))
    world = FormedWorld(truth, form, constants_of(truth))
    chance = np.random.default_rng([seed, 13])
    rigs = [of_one_flight(truth, rig, chance) for _ in range(FLIGHTS)]
    logs = [
        record(flown, seconds=SECONDS, seed=seed + i, model_rig=rig, **world.hooks())
        for i, flown in enumerate(rigs)
    ]
    flights = [
        flight_from_log(log.without_truth(), rig, f"flight {i}") for i, log in enumerate(logs)
    ]
    model, base = fitted_base(with_terms(GantryModel(rig, flights)))
    names = [n for n in LIBRARY if n not in {e.name for e in rig.effect}]
    model, base, ranked = ranked_by_own_motion(model, base, names, _LEAST_RANKED_NATS)
    waves = [name for name in SEARCHED if is_wave_in_time(name)]
    others = [name for name in SEARCHED if not is_wave_in_time(name)]
    return NullSet(
        effect_nats=ranked[0].gain_nats,
        effect=ranked[0].name,
        expression_nats=_best_term(rig, model, base, others),
        wave_nats=_best_term(rig, model, base, waves),
        whiteness=whiteness(base).at_reference,
        places=_largest(find_places(model, base, 0.0).places),
    )


def _best_term(rig: Rig, model: GantryModel, base: Fit, names: Sequence[str]) -> float:
    """The gain of the best term, also of one that the workflow would not have looked at twice."""
    setting = vars(setting_of(rig))
    found = search(model, base, setting=setting, names=names, least_nats=0.1, most_terms=1)
    if found is None:
        return 0.0
    return max(expressed_by_own_motion(model, base, found).gain_nats, 0.0)


def _largest(places: Sequence[Place]) -> dict[str, float]:
    sizes = dict.fromkeys(LEAST.places, 0.0)
    for place in places:
        sizes[place.channel] = max(sizes.get(place.channel, 0.0), abs(place.residual))
    return sizes


def _gumbel(values: np.typing.NDArray[np.float64], share: float) -> float:
    """The quantile of Gumbel's distribution with these values' mean and deviation."""
    scale = float(values.std(ddof=1)) * 6.0**0.5 / np.pi
    return float(values.mean() - 0.5772156649 * scale - scale * np.log(-np.log(share)))


def _shipped() -> dict[str, dict[str, float]]:
    source = files(__package__).joinpath("thresholds.json")
    if not source.is_file():
        return {}
    shipped = json.loads(source.read_text("utf-8"))
    if shipped["version"] != VERSION or _searched_beside():
        return {}
    return {sha: {k: float(v[k]) for k in asdict(LEAST)} for sha, v in shipped["rigs"].items()}


def _cached(rig: Rig) -> dict[str, float] | None:
    try:
        known = json_of(text_of(_cache_path(rig)))
        return {name: float(known[name]) for name in asdict(LEAST)}
    except (OSError, ValueError, KeyError, TypeError):
        return None  # never simulated, or unreadable: it is simulated again


def _cache_path(rig: Rig) -> Path:
    home = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    name = "-".join([f"gap-threshold-{VERSION}", *_searched_beside(), rig.sha256[:24]])
    return Path(home) / "wakedeploy" / f"{name}.json"


def _searched_beside() -> list[str]:
    """The effects of other packages: a search among more finds more by chance."""
    return [offer.name for offer in offers(EFFECTS).values() if offer.by != "wakedeploy"]
