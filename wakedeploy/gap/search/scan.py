"""Which effect a system lacks: all candidates are looked at around the base, the best are climbed.

In: a `Comparison` and a fit of what is known. Out: candidates ranked by their gain on episodes that
they were not fitted to, and the gain that chance alone would bring.
"""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from wakedeploy.gap.evidence.ascent import OPTIMISM, promised_nats
from wakedeploy.gap.evidence.fits import Fit, FloatArray, Free, own_parameters
from wakedeploy.gap.evidence.inference import settled
from wakedeploy.gap.evidence.ranking import Candidate, candidate
from wakedeploy.gap.progress import StepsDone, uncounted
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.climbing import (
    NEAR_NATS,
    begun,
    climbed,
    contending,
    height,
    raced,
    sized,
    to_the_end,
)
from wakedeploy.gap.search.comparison import Comparison, is_far_ahead
from wakedeploy.gap.search.first_look import Ground, Look, looks, white_rest
from wakedeploy.gap.search.imitation import imitated
from wakedeploy.gap.search.needed_gain import Chance
from wakedeploy.gap.search.sticking import begun_moving

CLIMBED, _MOST_CLIMBED = 6, 12  # kinds of candidates that are raced, and candidates
_STAGES = 5  # each about as long: looks, a race, climbs to the end, imitation, rest
_MOST_AT_REST = 5  # candidates near to the best, and itself, that are climbed until they rest
DRAWS = 200  # of what chance would bring
_AT_ONCE = 25
WORTH = 0.1  # share of the best prospect that a candidate needs to be fitted
_LOUDEST = 6.0  # sd of the largest innovation that counts in full
_TURNED = 50  # the fewest samples of a block whose sign chance turns
NOTHING: Mapping[str, Fit] = {}


def ranked(
    model: Comparison,
    base: Fit,
    names: Sequence[str],
    steps: StepsDone = uncounted,
    known: Mapping[str, Fit] = NOTHING,
) -> tuple[list[Candidate], Chance]:
    """Candidates on top of `base`, best first, and the gains that chance brings.

    `known` are fits of some candidates that began elsewhere.
    """
    ground, total = Ground.of(base), _STAGES * len(names)
    seen_all = looks(model, ground, names, lambda done, _: steps(done, total))
    order = sorted(seen_all, key=lambda seen: -seen.prospect(base))
    most = order[0].prospect(base) if order else 0.0
    least = max(RULES.least_nats, WORTH * most)
    chosen = _raced_among([seen for seen in order if seen.prospect(base) > least])
    fits = raced(model, base, [seen.fit for seen in chosen])
    running = {seen.name: reached for seen, reached in zip(chosen, fits, strict=True)}
    steps(2 * len(names), total)
    begun_as = {seen.name: seen.fit for seen in order}
    fitted = begun_as | running
    resting = _ends(model, base, begun_as, running)
    for elsewhere in (begun_moving(model, base, names), known):
        higher = {n: f for n, f in elsewhere.items() if height(f) > height(fitted[n])}
        fitted |= {name: _highest(model, base, reached) for name, reached in higher.items()}
    fitted |= {n: f for n, f in resting.items() if height(f) >= height(fitted[n])}
    steps(3 * len(names), total)
    fitted = imitated(model, base, fitted)
    steps(4 * len(names), total)
    fitted |= _rested(model, base, begun_as, fitted, resting)
    steps(total, total)
    best_first, chance = _compared(model, ground, order, fitted)
    if best_first and best_first[0].gain_nats < chance.nats and not base.hypothesis:
        remaining = [seen for seen in order if seen.name not in running]
        further = _from_their_starts(model, base, remaining)
        higher = {n: f for n, f in further.items() if height(f) > height(fitted[n])}
        if higher:
            best_first, chance = _compared(model, ground, order, fitted | higher)
    return best_first, chance


def _raced_among(promising: Sequence[Look]) -> list[Look]:
    """The best of the promising: of several kinds, each at the ports where it promises most.

    Of wheels, rotors or joints each has its gain and its drift, which promise as much. They alone
    would fill a race, and what truly is missing may promise less than these at first sight.
    """
    kinds: dict[str, list[Look]] = {}
    for seen in promising:
        kinds.setdefault(seen.name.partition("@")[0].partition("-from-")[0], []).append(seen)
    of_kinds = list(kinds.values())[:CLIMBED]
    in_turns = itertools.chain(*itertools.zip_longest(*of_kinds))
    chosen = list(itertools.islice((seen for seen in in_turns if seen), _MOST_CLIMBED))
    return [seen for seen in promising if seen in chosen]


def _ends(
    model: Comparison, base: Fit, starts: Mapping[str, Fit], running: Mapping[str, Fit]
) -> dict[str, Fit]:
    """Of those raced the leader, climbed to the end from its start, too.

    What may equal it is asked from its end later, for a fraction of the time. Not so what has
    several summits: beside the noise of a leader that explains less, its true size may explain no
    more than a wrong one.
    """
    if not running:
        return {}
    lead = max(running, key=lambda name: height(running[name]))
    ends = {name: _highest(model, base, running[name]) for name in contending(base, running)}
    ends = {name: end for name, end in ends.items() if end is not running[name]}
    points = [starts[lead].theta, running[lead].theta]
    led = to_the_end(model, base, points, running[lead])
    return ends if lead in ends and height(ends[lead]) > height(led) else {**ends, lead: led}


def _rested(
    model: Comparison,
    base: Fit,
    starts: Mapping[str, Fit],
    fitted: Mapping[str, Fit],
    resting: Mapping[str, Fit],
) -> dict[str, Fit]:
    """The best fit and those that may come near to it, at rest: a race may end below a summit.

    The best is climbed to the end, from its start in `starts`, too. Those that are `resting` do so
    already, and where none gains anything none is worth the time. Along a narrow ridge a race gets
    short of breath, and what it has not gained yet is what its last point promises.
    """
    order = sorted(fitted, key=lambda n: -height(fitted[n]))[:_MOST_AT_REST]
    highest = max((height(fitted[name]) for name in order), default=-np.inf)
    if highest < height(base) + RULES.least_nats:
        return {}
    rested: dict[str, Fit] = {}
    for name in order:
        reached = fitted[name]
        hoped = height(reached) + OPTIMISM * promised_nats(reached)
        if reached is resting.get(name) or hoped < highest - NEAR_NATS:
            continue
        if name == order[0]:
            rested[name] = to_the_end(model, base, [starts[name].theta], reached)
        else:
            rested[name] = settled(model, reached)[0]
    return rested


def _compared(
    model: Comparison, ground: Ground, order: Sequence[Look], fitted: Mapping[str, Fit]
) -> tuple[list[Candidate], Chance]:
    """Candidates best first, and what chance brings beside the first."""
    found = [candidate(ground.base, seen.name, fitted[seen.name], model) for seen in order]
    best_first = sorted(found, key=lambda c: -c.gain_nats)
    leader = best_first[0].fit if best_first else ground.base
    return best_first, chance_nats(ground, order, leader, by_block=is_far_ahead(model))


def _from_their_starts(model: Comparison, base: Fit, remaining: Sequence[Look]) -> dict[str, Fit]:
    """Fits of candidates that were not raced, from their first sizes, with all else free.

    Where constants have bent to what is missing, as a servo's to a backlash, no size promises
    anything beside them, and "nothing is missing" would be said beside hundreds of nats.
    """
    starts = []
    for seen in remaining:
        values = {f.name: f.starts[0] for f in _parameters_of_last(seen.fit) if f.starts}
        theta = sized(base, seen.fit, seen.fit.theta)
        starts.append(begun(model, seen.fit.hypothesis, base, np.array(
            [values.get(f.name, v) for f, v in zip(seen.fit.free, theta, strict=True)]
        )))  # fmt: skip
    fits = raced(model, base, starts)
    hopeful = {
        seen.name: fitted
        for seen, fitted in zip(remaining, fits, strict=True)
        if fitted.objective > base.objective + RULES.least_nats
    }
    return {name: settled(model, fitted)[0] for name, fitted in hopeful.items()}


def _highest(model: Comparison, base: Fit, fitted: Fit) -> Fit:
    """The highest of an effect's summits, if each of its sizes may have one.

    A summit shows its height once noise has shrunk to what its size leaves: with the base's noise,
    the right period of a hold explains no more than a wrong one. So they race each other.
    """
    starts = []
    for free in _parameters_of_last(fitted):
        for size in np.clip(free.scanned, free.low, free.high):
            theta = sized(base, fitted, fitted.theta)
            theta[fitted.names.index(free.name)] = size
            starts.append(begun(model, fitted.hypothesis, base, theta))
    if not starts:
        return fitted
    best = max(raced(model, base, starts), key=lambda f: f.objective)
    return settled(model, best)[0] if best.objective > fitted.objective else fitted


def _parameters_of_last(fitted: Fit) -> list[Free]:
    """The parameters of the effect that a fit added last."""
    return own_parameters(fitted.free, fitted.hypothesis[-1])


def chance_nats(
    ground: Ground, candidates: Sequence[Look], leader: Fit, *, by_block: bool
) -> Chance:
    """The best gain of any candidate that noise alone stays below in 19 of 20 cases.

    Noise is drawn anew around the base, with form and constants as wrong as their priors allow.
    Also, whole blocks of innovations change sign, which keeps what colours them. These are the best
    candidate's innovations: if it is the truth, what it explains is no noise. If a disturbance may
    colour a whole episode, `by_block` turns the episode as one.
    """
    rng = np.random.default_rng(0)
    bases = [_basis(columns, ground) for seen in candidates for columns in seen.columns]
    best = np.zeros((2, DRAWS))
    for first in range(0, DRAWS, _AT_ONCE):
        for row, draws in enumerate((_noise(ground, rng), _turned(leader, rng, by_block))):
            gains = [0.5 * ((basis.T @ draws) ** 2).sum(0) - basis.shape[1] for basis in bases]
            best[row, first : first + _AT_ONCE] = np.max(gains, axis=0, initial=0.0)
    sure = 1.0 - (RULES.false_alarms - RULES.steady_alarms)
    noise, turned = (max(float(np.quantile(row, sure)), RULES.least_nats) for row in best)
    return Chance(max(noise, turned), noise)


def _noise(ground: Ground, rng: np.random.Generator) -> FloatArray:
    """Noise in the units of whitened slopes, and nuisances as far off as their priors say."""
    base = ground.base
    weights = np.concatenate([
        np.concatenate([np.sqrt(s.weight) * (s.log_density != 0.0)] * 2) for s in base.slopes.scores
    ])  # fmt: skip
    noise = rng.standard_normal((len(weights), _AT_ONCE)) * weights[:, None]
    formal = [i for i, f in enumerate(base.free) if f.name.startswith("form.")]
    sd = np.array([base.free[i].prior_sd for i in formal])
    known = (ground.q @ ground.r[:, formal])[: len(weights)]
    return np.asarray(noise + known @ (sd[:, None] * rng.standard_normal((len(sd), _AT_ONCE))))


def _turned(leader: Fit, rng: np.random.Generator, by_block: bool) -> FloatArray:
    """A fit's own whitened innovations, pieces of them with signs turned, (2n, draws).

    One event in a log, such as a blow, must not decide what chance brings to all of it: a gain from
    one event alone counts for nothing anyway, as no other block bears it out.
    """
    parts = []
    for score in leader.slopes.scores:
        rest = white_rest(score)
        n = len(rest) // 2
        rest[:n] = np.clip(rest[:n], -_LOUDEST, _LOUDEST)
        rest[n:] = np.minimum(rest[n:], 0.5**0.5 * (_LOUDEST**2 - 1.0))
        count = 1 if by_block else max(n // _TURNED, 4)
        signs = rng.choice((-1.0, 1.0), (count, _AT_ONCE))
        of = np.minimum(np.arange(n) * count // n, count - 1)
        parts += [rest[:n, None] * signs[of], rest[n:, None] * signs[of]]
    return np.concatenate(parts)


def _basis(columns: FloatArray, ground: Ground) -> FloatArray:
    """Orthonormal directions (2n, k) of a candidate's columns beyond the known directions."""
    largest = np.abs(columns).max(axis=0, initial=0.0)  # its square may overflow
    columns = columns[:, (largest > 0.0) & np.isfinite(largest)]
    columns = columns / np.abs(columns).max(axis=0, initial=0.0)
    residual = ground.residual(columns)
    norm = np.linalg.norm(residual, axis=0)
    there = norm > 1e-8 * np.linalg.norm(columns, axis=0)
    if not there.any():
        return np.zeros((len(columns), 0))
    basis, _ = np.linalg.qr(residual[:, there] / norm[there])
    return np.asarray(basis[: len(columns)])


def elaborates(model: Comparison, name: str, other: str) -> bool:
    """Whether an effect is the same as another with more to it, at the same port."""
    return other in model.simpler_effects(name)


def refines(model: Comparison, name: str, other: str) -> bool:
    """Whether an effect is a finer law of the friction that another is, at the same port."""
    return model.is_friction_law(name) and elaborates(model, name, other)


def simpler(
    model: Comparison, base: Fit, best: Candidate, others: Sequence[Candidate] = ()
) -> Candidate:
    """A simpler kind at the same port, if it gains nearly as much; else the best.

    It is one of `others`, or is fitted from the best one's point. If that gains too little, it is
    climbed to the end, also from where its own fit stopped: a race leaves what falls behind on the
    way, and it would lose its name to a law that only has more to it.
    """
    known = {other.name: other for other in others}
    least = RULES.simpler_share * best.gain_nats
    for name in model.simpler_effects(best.name):
        if name not in model.effects or name in base.hypothesis:
            continue
        if name in known and known[name].gain_nats >= least:
            return known[name]
        values = {n.replace(f"{best.name}.", f"{name}."): best.fit.value(n) for n in best.fit.names}
        hypothesis = (*base.hypothesis, name)
        start = np.array([values.get(f.name, f.neutral) for f in model.free(hypothesis)])
        fitted = climbed(model, begun(model, hypothesis, base, start))
        simple = candidate(base, name, fitted, model)
        if simple.gain_nats >= least:
            return simple
        points = [start, *([known[name].fit.theta] if name in known else [])]
        simple = candidate(base, name, to_the_end(model, base, points, fitted), model)
        if simple.gain_nats >= least:
            return simple
    return best
