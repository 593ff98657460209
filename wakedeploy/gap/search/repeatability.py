"""Whether two halves of the recordings, each by itself, give the same answer.

An answer that only all recordings together give may rest on one part of them. Each half is fitted
by itself, from where the base stands. It ranks what was found first, its nearest rivals, and what
its own slopes promise most. The other named effects stand beside each of these, not as rivals.

In: the outcome of a search. Out: what each half ranks first, at which size, and whether they agree.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from wakedeploy.gap.evidence.fits import NO_SLOPES, Fit, FloatArray, densities, scores_of
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import Candidate, candidate
from wakedeploy.gap.progress import Progress, quiet
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import Half, Lead, Repeated, Round
from wakedeploy.gap.search.climbing import height, raced
from wakedeploy.gap.search.comparison import Comparison, searched_on, theta_from
from wakedeploy.gap.search.first_look import Ground, looks
from wakedeploy.gap.search.outcome import ACCEPTED, CHANCE, Named, verdict_of
from wakedeploy.gap.search.rivalry import rivals_with, sizes_of
from wakedeploy.gap.search.scan import WORTH, elaborates
from wakedeploy.gap.search.sizes import least_squares, parameters

RIVALS = 3  # of the whole search's ranking that each half looks at as well
PROMISING = 3  # others that each half looks at by its own slopes
_MANY_LOGS = 6  # from six logs on, a half is of whole logs: three at least


def repeated(outcome: Named, progress: Progress = quiet) -> Repeated[Half] | None:
    """Both halves' answers about the first effect found; None where there is nothing to repeat.

    That is where nothing was named, or a half has too few episodes for a verdict. Of long
    recordings each half has what the search looks at.
    """
    if not outcome.found.hypothesis or verdict_of(outcome) == "unknown":
        return None
    model = searched_on(outcome.model)
    halves = halves_of(model)
    if min(map(len, halves)) < RULES.fewest_flights:
        return None
    progress("asking each half of the logs")
    asked = _Asked.of(outcome, model)
    first, other = (asked.of_half(episodes) for episodes in halves)
    return Repeated(agree=agree(first, other, asked.claimed), halves=[first, other])


def agree(first: Lead, other: Lead, claimed: Collection[str]) -> bool:
    """Whether both rank first what is claimed, gain something, and have sizes that overlap.

    Sizes of two different members of a class are not comparable, and are ignored.
    """
    if not all(half.leading in claimed and half.gain_nats > 0.0 for half in (first, other)):
        return False
    return first.leading != other.leading or (first.low <= other.high and other.low <= first.high)


def halves_of(model: Comparison) -> tuple[list[int], list[int]]:
    """Every second log if there are many; else the first and second half of each log in time."""
    logs: dict[int, list[int]] = {}
    for episode in range(model.episodes):
        logs.setdefault(model.log_of(episode), []).append(episode)
    parts: tuple[list[int], list[int]] = [], []
    if len(logs) >= _MANY_LOGS:
        for k, episodes in enumerate(logs.values()):
            parts[k % 2].extend(episodes)
        return parts
    for k, episodes in enumerate(logs.values()):
        middle = (len(episodes) + k % 2) // 2  # the halves get an odd one in turn
        parts[0].extend(episodes[:middle])
        parts[1].extend(episodes[middle:])
    return parts


@dataclass(frozen=True, eq=False)
class _Asked:
    """What each half is asked: about `found`, beside the `others` that were named.

    `rivals` come from the whole search's ranking; `refused` gained more than chance but were turned
    down. `known` are the whole search's fits, from which those of a half start.
    """

    model: Comparison
    base: Fit
    whole: Fit
    found: str
    others: tuple[str, ...]
    claimed: tuple[str, ...]
    rivals: tuple[str, ...]
    refused: frozenset[str]
    known: Mapping[str, Fit]

    @classmethod
    def of(cls, outcome: Named, model: Comparison) -> "_Asked":
        found, *others = outcome.found.hypothesis
        claimed = outcome.rivals if found in outcome.rivals else (found,)
        ranking = _round_of(outcome.rounds, found).ranking
        refused = {*outcome.withdrawn, *others}
        refused |= {c.name for c in ranking if c.judged not in ("", ACCEPTED, CHANCE)}
        refused -= {*claimed}
        rivals = [c.name for c in ranking if c.name not in {found, *refused}]
        return cls(
            model=model,
            base=outcome.base,
            whole=outcome.found,
            found=found,
            others=tuple(others),
            claimed=claimed,
            rivals=tuple(rivals[:RIVALS]),
            refused=frozenset(refused),
            known={c.name: c.fit for c in outcome.alone} | {found: outcome.found},
        )

    def of_half(self, episodes: Sequence[int]) -> Half:
        """What leads in some episodes."""
        start = theta_from(self.model, self.others, self.whole, self.base)
        base = fit(self.model, self.others, episodes, start)
        ranked = self._ranked(base)
        leading = self._leading(ranked)
        near = [c for c in ranked if c is leading or self._is_near(c, ranked[0], leading)]
        leading = candidate(base, leading.name, self._at_its_top(leading.fit), self.model)
        free = sizes_of(leading.fit, leading.name)[0]
        plain = least_squares(self.model, leading.fit)
        size = parameters(self.model, leading.fit, (leading.name,), plain)[free.name]
        return Half(
            episodes=[self.model.records[e].name for e in episodes],
            leading=leading.name,
            gain_nats=leading.gain_nats,
            near=[c.name for c in near],
            parameter=free.name.removeprefix(f"{leading.name}."),
            low=size.low,
            high=size.high,
            unit=free.unit,
        )

    def _ranked(self, base: Fit) -> list[Candidate]:
        """What was found, its rivals and promising others, ranked by their gain in a half."""
        model, ground = self.model, Ground.of(base)
        wanted = (self.found, *self.rivals)
        names = [n for n in model.effects if n not in self.refused]
        order = sorted(looks(model, ground, names), key=lambda seen: -seen.prospect(base))
        further = [seen.name for seen in order if seen.name not in wanted][:PROMISING]
        chosen = [seen for seen in order if seen.name in {*wanted, *further}]
        fits = {seen.name: self._start(seen.name, seen.fit) for seen in chosen}
        prospects = {s.name: max(s.promised, _gained(base, fits[s.name])) for s in chosen}
        least = max(RULES.least_nats, WORTH * max(prospects.values()))
        able = [n for n in fits if n == self.found or prospects[n] > least]
        fits |= dict(zip(able, raced(model, base, [fits[n] for n in able]), strict=True))
        ranked = [
            candidate(base, name, fits[name], model) for name in fits if fits[name].slopes.scores
        ]
        return sorted(ranked, key=lambda c: -c.gain_nats)

    def _at_its_top(self, raced_fit: Fit) -> Fit:
        hypothesis, episodes, slopes = raced_fit.hypothesis, raced_fit.episodes, raced_fit.slopes
        return fit(self.model, hypothesis, episodes, raced_fit.theta, slopes)

    def _start(self, name: str, seen: Fit) -> Fit:
        """Where a first look ended, or the whole search's point if that is higher here."""
        if name not in (self.found, *self.rivals) or name not in self.known:
            return seen
        theta = theta_from(self.model, seen.hypothesis, self.whole, self.known[name])
        return max(seen, _scored(self.model, seen, theta), key=height)

    def _leading(self, ranked: Sequence[Candidate]) -> Candidate:
        """What was found, or a member of its class, if the half cannot tell it from the best one.

        The best one does not count either if it is the same with more to it and gains little more.
        """
        best, by_name = ranked[0], {c.name: c for c in ranked}
        for name in (self.found, *self.claimed):
            known = by_name.get(name)
            if known is not None and (rivals_with(best, known) or self._is_simpler(known, best)):
                return known
        return best

    def _is_simpler(self, known: Candidate, best: Candidate) -> bool:
        enough = known.gain_nats >= RULES.simpler_share * best.gain_nats
        return enough and elaborates(self.model, best.name, known.name)

    def _is_near(self, other: Candidate, best: Candidate, leading: Candidate) -> bool:
        is_same = elaborates(self.model, other.name, leading.name)
        return rivals_with(best, other) and not is_same


def _round_of(rounds: Sequence[Round], found: str) -> Round:
    """The round that chose an effect; for one found in a pair, the first that ranked it."""
    chosen = [r for r in rounds if r.chosen == found]
    ranked = [r for r in rounds if any(c.name == found for c in r.ranking)]
    return (chosen or ranked)[0]


def _scored(model: Comparison, like: Fit, theta: FloatArray) -> Fit:
    """Another point of a fit's hypothesis, on its episodes; it has no slopes yet."""
    scores = scores_of(model, like.hypothesis, theta[None], like.episodes)[0]
    return Fit(like.hypothesis, like.free, like.episodes, theta, NO_SLOPES, densities(scores))


def _gained(base: Fit, fitted: Fit) -> float:
    return height(fitted) - base.objective
