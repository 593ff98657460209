"""Which input to record next: the one that makes an effect seen, or splits a class best.

In: a `LogModel`, its base fit, the names of an effect or of a class. Out: for every input of a menu
the nats by which the closest rival would lose in one such log (or an effect would gain), and how
many logs that takes with margin. Inputs stay within the limits that the system states for them
(those of the logs without), outputs within what the logs have seen and a little beyond; the system
is simulated, and judged by the likelihood that `gap name` uses.
"""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.ascent import slopes_at
from wakedeploy.gap.evidence.fits import Fit, FloatArray, bounds_of, densities
from wakedeploy.gap.progress import StepsDone, uncounted
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.planning.excitation import MENU, Excitation
from wakedeploy.gap.systems.planning.imagined import imagined
from wakedeploy.gap.systems.planning.responses import Responses, lost_nats

Pair = tuple[str, ...]  # of a class; of a single effect its name alone
Losses = Mapping[Pair, float]

_NOTHING = 1e-3 * RULES.margin_nats  # in one log: a thousand of them would not be enough
_SHARES = (1.0, 0.5, 0.25, 0.1, 0.03)  # of the limits, the largest that the outputs allow
_BEYOND = 0.25  # of their range, by which outputs may leave what the logs have seen
_MULTIPLES = 2.0 ** np.linspace(-4.0, 2.0, 13)  # of a rival's size
_SHORTEST = 200  # samples of an imagined log, which ends where its outputs leave
_NEXT_TO = 0.05  # share of the limits; a mean so near to their middle is it
_LONGEST = 3000  # samples of an imagined log


@dataclass(frozen=True, eq=False)
class Option:
    """An input: `moved` the inputs that it moves, by `share` of their limits, and what it shows.

    `nats` is what one such log gives: for a class, on the closest pair that some input tells apart;
    `columns` (n,) by name, the inputs to record with and outputs as they would be. `about` is the
    level from which each moved input goes up and down; `is_held` where it is what the logs hold on
    average, as about the middle of the limits outputs leave sooner.
    """

    excitation: Excitation
    moved: tuple[str, ...]
    share: float
    seconds: float
    nats: float
    columns: Mapping[str, FloatArray]
    about: Mapping[str, float] = field(default_factory=dict)
    is_held: bool = False

    @property
    def logs(self) -> int | None:
        """How many such logs are enough, with margin; None if no number is."""
        return math.ceil(RULES.margin_nats / self.nats) if self.nats > _NOTHING else None


@dataclass(frozen=True, eq=False)
class Plan:
    """Options, best first; `logged_nats` is what as long a piece of the present logs gives.

    `alike` are pairs that no input tells apart. What options give is for the other pairs. `units`
    are those of the inputs.
    """

    names: tuple[str, ...]
    options: tuple[Option, ...]
    logged_nats: float
    alike: tuple[Pair, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)

    @property
    def best(self) -> Option | None:
        """The input to record; None if none gives enough, or none more than the present logs.

        One that gives enough in a single log is worth it in any case.
        """
        first = self.options[0] if self.options else None
        if first is None or first.logs is None:
            return None
        return None if first.logs > 1 and first.nats < self.logged_nats else first


def plan(
    model: LogModel,
    base: Fit,
    names: Sequence[str],
    sizes: Mapping[str, Sequence[float]] | None = None,
    steps: StepsDone = uncounted,
) -> Plan:
    """Judge every input of the menu; `sizes` are the effects' parameters where they are known.

    Raises UnusableInput for no name, an unknown one, and a system whose inputs nobody can command.
    """
    chosen = tuple(dict.fromkeys(names))
    require_names(model, chosen)
    responses = Responses(model, base)
    usual = {n: tuple(map(float, responses.usual(n)[0])) for n in chosen}
    known = usual | {n: tuple(size) for n, size in (sizes or {}).items() if n in chosen}
    samples = min(max(log.inputs.shape[1] for log in model.logs), _LONGEST)
    tried = _imagined(model, base, samples)
    losses = []
    for done, option in enumerate(tried, 1):
        losses.append(_losses(*_at_base(model, base, option.columns), known))
        steps(done, len(tried))
    alike = _alike(model, losses)
    options = [replace(o, nats=_least(of, alike)) for o, of in zip(tried, losses, strict=True)]
    order = sorted(options, key=lambda o: -o.nats)
    share = samples / sum(log.inputs.shape[1] for log in model.logs)
    logged = share * _least(_losses(model, base, known), alike)
    units = {i.name: i.unit for i in model.system.logged}
    return Plan(chosen, tuple(order), logged, alike, units)


def _alike(model: LogModel, losses: Sequence[Losses]) -> tuple[Pair, ...]:
    """Pairs that no input tells apart: more logs would not help either."""
    pairs = losses[0] if losses else {}
    return tuple(
        p
        for p in pairs
        if len(p) > 1 and (_same_delay(model, p) or not max(of[p] for of in losses) > _NOTHING)
    )


def _same_delay(model: LogModel, pair: Pair) -> bool:
    """Whether both delay all that a system does: before its only input, or behind its only output.

    A fast input seems to tell the two apart, but shows only how each is computed.
    """
    system = model.system
    before = {f"dead-time@{i.name}" for i in system.inputs}
    behind = {f"sensor-dead-time@{o.name}" for o in system.outputs}
    both = len(set(pair) & before) == len(set(pair) & behind) == 1
    return len(system.logged) == len(system.outputs) == 1 and both


def _least(losses: Losses, alike: Sequence[Pair]) -> float:
    """The fewest nats of a pair that some input tells apart; 0 without such a pair."""
    return min((nats for pair, nats in losses.items() if pair not in alike), default=0.0)


def require_names(model: LogModel, names: Sequence[str]) -> None:
    """UnusableInput for what no plan can look for: no name, no such effect, nothing to command."""
    model.require_effects()
    model.acting(tuple(names))
    if not names:
        raise UnusableInput(f"{model.name}: no effect to look for; name one or a class of them.")
    if not commanded(model):
        raise UnusableInput(
            f"{model.name} has no input that can be commanded, so that there is none to choose."
        )


def commanded(model: LogModel) -> tuple[str, ...]:
    """The inputs that a person can choose."""
    return tuple(i.name for i in model.system.logged if i.is_commanded)


def _candidates(model: LogModel) -> Iterator[tuple[Excitation, tuple[str, ...]]]:
    """Every shape for each commanded input alone, and for all together."""
    together = commanded(model)
    alone = [(name,) for name in together]
    yield from itertools.product(MENU, [*alone, together] if len(alone) > 1 else alone)


def _imagined(model: LogModel, base: Fit, samples: int) -> list[Option]:
    """Every candidate as large as outputs allow for the longest time, with its outputs.

    All are simulated side by side; those are left out that drive outputs too far at once.
    """
    limits = _limits(model)
    tried = [
        (excitation, moved, share, about, is_held)
        for (excitation, moved), share in itertools.product(_candidates(model), _SHARES)
        for is_held, about in enumerate(_centres(limits, moved, share))
    ]
    each = [
        _columns(model, limits, excitation, moved, share, about, samples)
        for excitation, moved, share, about, _ in tried
    ]
    columns = {i.name: np.array([driven[i.name] for driven in each]) for i in model.system.logged}
    shown = imagined(model, base, columns)
    longest: dict[tuple[str, tuple[str, ...], bool], Option] = {}
    for k, (excitation, moved, share, about, is_held) in enumerate(tried):
        outputs = {name: rows[k] for name, rows in shown.items()}
        stays, key = _stays(model, outputs), (excitation.name, moved, bool(is_held))
        known = longest.get(key)
        if stays >= _SHORTEST and (known is None or stays * model.dt_s > known.seconds):
            cut = {n: v[:stays] for n, v in (each[k] | outputs).items()}
            longest[key] = Option(
                excitation, moved, share, stays * model.dt_s, 0.0, cut, about, bool(is_held)
            )
    return _worth_judging(list(longest.values()))


def _worth_judging(options: Sequence[Option]) -> list[Option]:
    """Without inputs about a mean that last no longer than the same about the middle.

    Those that do are judged beside it: a small one that lasts may tell less than a large one.
    """
    plain = {(o.excitation.name, o.moved): o.seconds for o in options if not o.is_held}
    return [
        o
        for o in options
        if not o.is_held or o.seconds > plain.get((o.excitation.name, o.moved), 0.0)
    ]


def _limits(model: LogModel) -> dict[str, tuple[float, float, float]]:
    """Between what each logged input is tried, and its mean in the logs, bounded by that."""
    found = {}
    for i, stated in enumerate(model.system.inputs):
        if stated.law is None:
            logged = np.concatenate([log.inputs[i] for log in model.logs])
            low = float(logged.min()) if stated.low is None else stated.low
            high = float(logged.max()) if stated.high is None else stated.high
            found[stated.name] = (low, high, float(np.clip(logged.mean(), low, high)))
    return found


def _centres(
    limits: Mapping[str, tuple[float, float, float]], moved: tuple[str, ...], share: float
) -> list[dict[str, float]]:
    """About what inputs move: the middles of their limits, and what the logs hold on average.

    Buoyancy or a weight alone carries many a system away from the middle. It stayed where it is
    while the logs were recorded, so that on average it was held. As near to that as this share of
    the limits allows, where it is not next to the middle anyway.
    """
    middle, mean, is_apart = {}, {}, False
    for name in moved:
        low, high, held = limits[name]
        middle[name], off = 0.5 * (low + high), (1.0 - share) * 0.5 * (high - low)
        mean[name] = middle[name] + float(np.clip(held - middle[name], -off, off))
        is_apart |= abs(mean[name] - middle[name]) > _NEXT_TO * (high - low)
    return [middle, mean] if is_apart else [middle]


def _columns(
    model: LogModel,
    limits: Mapping[str, tuple[float, float, float]],
    excitation: Excitation,
    moved: tuple[str, ...],
    share: float,
    about: Mapping[str, float],
    samples: int,
) -> dict[str, FloatArray]:
    """Inputs (n,) by name; what is not moved stays at its logged mean."""
    columns = {}
    for i, stated in enumerate(model.system.inputs):
        if stated.name not in limits:
            continue
        low, high, held = limits[stated.name]
        value = np.full(samples, held)
        if stated.name in moved:
            value = about[stated.name] + share * 0.5 * (high - low) * excitation.made(samples, i)
        columns[stated.name] = value
    return columns


def _stays(model: LogModel, shown: Mapping[str, FloatArray]) -> int:
    """For how many samples outputs stay where logs have been, or a little beyond."""
    stays = len(next(iter(shown.values())))
    for i, output in enumerate(model.system.outputs):
        logged = np.concatenate([log.outputs[i] for log in model.logs])
        low, high = float(np.nanmin(logged)), float(np.nanmax(logged))
        more = _BEYOND * (high - low)
        outside = ~((shown[output.name] >= low - more) & (shown[output.name] <= high + more))
        stays = min(stays, int(np.argmax(outside)) if outside.any() else stays)
    return stays


def _at_base(model: LogModel, base: Fit, columns: Mapping[str, FloatArray]) -> tuple[LogModel, Fit]:
    """An imagined log, with noise and constants as the real ones have them."""
    time_s = np.asarray(model.dt_s * np.arange(len(next(iter(columns.values())))))
    other = LogModel(
        model.system, [Recording("imagined", time_s, columns, clocks=model.recordings[0].clocks)]
    )
    other.offer(model.library)
    free = other.free(base.hypothesis)
    known = dict(zip(base.names, base.theta, strict=True))
    alike = {f.name for f in free if not f.is_form and not f.name.startswith("form.")}
    theta = np.array([known.get(f.name, f.neutral) if f.name in alike else f.neutral for f in free])
    theta = np.clip(theta, *bounds_of(free))
    used = tuple(range(other.episodes))
    slopes = slopes_at(other, base.hypothesis, used, theta)
    return other, replace(base, free=free, episodes=used, theta=theta, slopes=slopes,
                          per_episode=densities(slopes.scores))  # fmt: skip


def _losses(model: LogModel, base: Fit, sizes: Mapping[str, Sequence[float]]) -> Losses:
    """What the rival of each pair of a class loses, or by its own name what an effect gains."""
    responses = Responses(model, base)
    points = {n: np.array([size], dtype=float) for n, size in sizes.items()}
    truths = {n: responses.of(n, at)[0] for n, at in points.items()}
    if len(sizes) == 1:
        return {(n,): float(0.5 * (t @ t)) for n, t in truths.items()}
    curves = {n: responses.of(n, responses.scaled(n, at, _MULTIPLES)[0])[None]
              for n, at in points.items()}  # fmt: skip
    return {
        (a, b): min(lost_nats(truths[a], curves[b]), lost_nats(truths[b], curves[a]))
        for a, b in itertools.combinations(sizes, 2)
    }
