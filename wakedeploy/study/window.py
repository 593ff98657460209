"""Study: how much of the past a predictor has to see.

In: episode sets. Out: for each domain the error of its main force channel against the past that is
seen, from none (the memoryless model) to one and a half of the domain's usual window. All are
scored on the same test samples: those that have the longest window before them.

A window model is trained anew for each length. It sees snapshots as everywhere, at most 45, so that
long windows are coarser. It learns from every sample that has its own window before it, which gives
short windows a few more samples in training, never in the test.

A recurrent model is trained once, as usual, and then its past is cut: each scored sample is
predicted from a state that began anew that long before. Training never scores a state as young as
that, so that what suffices here is an upper bound; one trained to start anew could do with less, at
the price of a training for each length. Its error with the state carried on from the
episode's start stands beside it. On board it keeps its state, however long that past is; a window
model keeps the samples of its window.

Where a set says which channels show the sufferer's own motion, each model stands there once
more, kept from their past: else the shortest past that suffices may be that for differentiating
them. Beside the models: predicting nothing, and a set's observer of that motion, which learns
nothing.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from wakedeploy.core.episodes import EpisodeSet, window_shape
from wakedeploy.core.errors import UnusableInput
from wakedeploy.study.domains import MEMORYLESS, hidings, label
from wakedeploy.study.runs import Wanted, best_run, candidates
from wakedeploy.study.uncertainty import FloatArray, r2_with_interval, units_of

SHARES = (1 / 16, 1 / 8, 1 / 4, 1 / 2, 3 / 4, 1.0, 1.5)  # of the domain's usual window
WHOLE = math.inf  # the past since the episode's start
TOLERANCE = 1.05  # how much above the least error a window may be that suffices
_MOST_SCORED = 3000  # neighbouring samples err alike: more would say little
_FLOAT_BYTES = 4


@dataclass(frozen=True)
class Seen:
    """One point: the error of one trained model that sees `past_s` seconds of the past.

    `past_s` is 0 for the present alone and `WHOLE` for a state carried on from the episode's start;
    `samples` counts what is seen, the present included (None for `WHOLE`). `bytes` is what has to
    be kept from one sample to the next, by `memory`: the carried state of a "state" model, those
    samples of a "window" model; of "none", the one that is seen. Error and `sd` are those of the
    domain's main channel in its unit; `scored` counts samples, and `r2_low` and
    `r2_high` bound the 90 % interval of R². `hyper` says what differs from the usual.
    """

    domain: str
    arch: str
    seed: int
    past_s: float
    memory: str
    samples: int | None
    bytes: int
    rmse: float
    sd: float
    r2: float
    r2_low: float | None
    r2_high: float | None
    scored: int
    hyper: str = ""

    @property
    def share(self) -> float:
        """The error over the channel's standard deviation."""
        return self.rmse / self.sd

    def as_json(self) -> dict[str, Any]:
        """Every number; `past_s` is None for the whole past."""
        return vars(self) | {"past_s": None if self.past_s == WHOLE else self.past_s}


@dataclass(frozen=True)
class Need:
    """The shortest past with which an architecture comes within `TOLERANCE` of its least error.

    For a model that carries a state it is an upper bound: see the file's head.
    Errors are means over seeds, over the standard deviation; `least` over every past it was given,
    without the memoryless model. `enough` is None where only the whole past suffices, and the
    memoryless model where that does.
    """

    arch: str
    enough: Seen | None
    error: float
    least: float
    memoryless: float

    @property
    def loses(self) -> bool:
        """Whether the memoryless model is better than it is with any past."""
        return self.least > self.memoryless


def planned(
    data: EpisodeSet, architectures: Sequence[str], seeds: int, epochs: int | None = None
) -> list[tuple[EpisodeSet, Wanted]]:
    """The runs that `measure` needs, each with the set that gives it its window."""
    asked = _asked(data, architectures, seeds, epochs)
    return [(seen, candidate) for seen, wanted in asked for candidate in candidates(wanted)]


def _asked(
    data: EpisodeSet, architectures: Sequence[str], seeds: int, epochs: int | None
) -> list[tuple[EpisodeSet, Wanted]]:
    """One for each model that is scored."""
    jobs = [(data, Wanted(MEMORYLESS, seed, epochs)) for seed in range(seeds)]
    for hidden in hidings(data):
        for arch in with_memory(architectures):
            sets = windows(data) if _kind(arch, data) == "window" else [data]
            jobs += [
                (seen, Wanted(arch, seed, epochs, present_only=hidden))
                for seen in sets
                for seed in range(seeds)
            ]
    return jobs


def windows(data: EpisodeSet) -> list[EpisodeSet]:
    """The set with each window of `SHARES`, shortest first; its own where the share is 1."""
    usual = data.window_s * data.rate_hz
    steps = {max(1, round(share * usual)): share for share in SHARES}
    return [
        data if share == 1.0 else replace(data, window_s=count / data.rate_hz)
        for count, share in steps.items()
    ]


def reach(data: EpisodeSet) -> int:
    """How many samples before the present the oldest snapshot of the set's window lies."""
    k, stride = window_shape(data.window_s, data.rate_hz)
    return (k - 1) * stride


def measure(
    data: EpisodeSet,
    main: str,
    architectures: Sequence[str],
    seeds: int,
    runs: Path,
    *,
    epochs: int | None = None,
) -> list[Seen]:
    """Score the channel `main` for every past, memoryless first; trains what is not trained yet.

    Raises UnusableInput where no test episode is longer than the longest window.
    """
    scale = _Scale(data, main)
    points = list(scale.unlearned())
    for made, asked in _asked(data, architectures, seeds, epochs):
        run, wanted = best_run(made, asked, runs)
        predictor = run.predictor
        for past, error in scale.errors(predictor, made):
            points.append(scale.point(wanted, predictor.memory, past, error))
    return points


def need(points: Sequence[Seen], arch: str) -> Need:
    """What one domain's points say of an architecture, the memoryless model its shortest past."""
    compared = [p for p in points if p.arch in (arch, MEMORYLESS)]
    mean = {
        past: float(np.mean([p.share for p in compared if p.past_s == past]))
        for past in sorted({p.past_s for p in compared})
    }
    least = min(value for past, value in mean.items() if past > 0.0)
    shortest = next(past for past in mean if mean[past] <= TOLERANCE * least)
    found = next(p for p in compared if p.past_s == shortest)
    enough = None if shortest == WHOLE else found
    return Need(arch, enough, mean[shortest], least, mean[0.0])


def architectures_of(points: Sequence[Seen]) -> list[str]:
    """Those with memory, in the order in which they came."""
    return list(dict.fromkeys(p.arch for p in points if p.memory != "none"))


def unlearned_of(points: Sequence[Seen]) -> list[Seen]:
    """What has learned nothing: predicting nothing, and a set's observer."""
    return [p for p in points if p.memory == "none" and p.arch != MEMORYLESS]


def transport_delay_s(data: EpisodeSet) -> float | None:
    """How long the wake is under way on average, if a set and its simulation say it; else None.

    On fish it is the lag at which the flag's tip follows the foil best.
    """
    from wakedeploy.study.basin import echo_of
    from wakedeploy.study.delay import DISTANCE, nominal, transport
    from wakedeploy.study.sets import DOMAINS

    if data.domain == "fish":
        return echo_of(data).true_s
    if data.domain in ("downwash", "gantry") and DISTANCE in {c.name for c in data.observation}:
        return transport(data, nominal(data.domain, DOMAINS[data.domain]).speed_mps).mean_s
    return None


def sentence(
    domain: str, points: Sequence[Seen], rate_hz: float, delay_s: float | None = None
) -> str:
    """What a domain's points say, in one sentence; `delay_s` is the wake's, where it is known."""
    longest = max((p.past_s for p in points if p.past_s < WHOLE), default=0.0)
    sentences = [
        _need_text(need(points, arch), rate_hz, longest) for arch in architectures_of(points)
    ]
    if not sentences:
        return f"On {domain}, no model with memory was trained."
    known = "" if delay_s is None else f" The wake is under way for {delay_s:.3f} s on average."
    return f"On {domain}, {'; '.join(sentences)}.{known}"


def _need_text(found: Need, rate_hz: float, longest_s: float) -> str:
    errors = f"{found.error:.2f} of the standard deviation"
    if found.loses:
        return (
            f"{found.arch} loses to the memoryless model: {found.least:.2f} of the standard "
            f"deviation at best, {found.memoryless:.2f} without memory"
        )
    if found.enough is None:
        return (
            f"{found.arch}, as it was trained, comes within 5 % of its least error ({errors}) with "
            f"all of the past and not with {longest_s:.3g} s, which bounds nothing"
        )
    if found.enough.past_s == 0.0:
        return (
            f"{found.arch} gains no more than 5 % by the past: {found.least:.2f} of the standard "
            f"deviation with it, {found.memoryless:.2f} without"
        )
    needs = "needs no more than" if found.enough.memory == "state" else "needs"
    return (
        f"{found.arch} {needs} {found.enough.past_s:.3g} s of the past, "
        f"{_kept(found.enough, rate_hz)}, for an error within 5 % of its least ({errors}, "
        f"{found.memoryless:.2f} without memory)"
    )


def _kept(seen: Seen, rate_hz: float) -> str:
    """What a computer on board has to keep for it."""
    if seen.memory == "state":
        return f"kept in a state of {seen.bytes:,} bytes without a history"
    return f"a history of {seen.samples} samples or {seen.bytes:,} bytes at {rate_hz:g} Hz"


def with_memory(architectures: Sequence[str]) -> list[str]:
    """Those that see a past. Raises UnusableInput where there is none among them."""
    found = [arch for arch in architectures if arch != MEMORYLESS]
    if not found:
        raise UnusableInput(
            f"{MEMORYLESS} sees no past and is compared with in any case; give --arch a model with "
            "memory."
        )
    return found


def _kind(arch: str, data: EpisodeSet) -> str:
    from trainers.build import build

    inputs, outputs = len(data.observation), len(data.force)
    core = build(arch, inputs=inputs, outputs=outputs, window_s=data.window_s, rate_hz=data.rate_hz)
    return core.memory.kind


class _Scale:
    """The test samples that everything is scored on: those after the longest window's warm-up."""

    def __init__(self, data: EpisodeSet, main: str) -> None:
        from trainers.training.tape import lay_tape

        self.data, self.lengths = data, [reach(seen) for seen in windows(data)]
        self.warm_up = max(data.warm_up_steps, *(seen.warm_up_steps for seen in windows(data)))
        self.tape = lay_tape(data, "test", 0.0, self.warm_up)
        scored = np.flatnonzero(self.tape.scored.numpy())
        every = -(-len(scored) // _MOST_SCORED)
        self.chosen: npt.NDArray[np.int64] = scored[::every]
        episode = self.tape.first[scored].numpy()
        self.units = units_of(data, episode, warm_up=self.warm_up)[::every]
        self.channel = [channel.name for channel in data.force].index(main)
        self.truth = self._of(self.tape.force[self.chosen])

    def errors(self, predictor: Any, seen: EpisodeSet) -> Iterator[tuple[int | None, FloatArray]]:
        """The past in samples (None: all) and the errors (M,), for each past to score it with."""
        from trainers.inspection.cold_start import predict_from_cold
        from trainers.training.predict import predict

        if predictor.memory.kind == "state":
            for past in self.lengths:
                cut = predict_from_cold(predictor, self.tape, self.chosen, past)
                yield past, self._of(cut) - self.truth
            past_or_all = None
        else:
            past_or_all = reach(seen) if predictor.memory.kind == "window" else 0
        yield past_or_all, self._of(predict(predictor, self.tape)[self.chosen]) - self.truth

    def unlearned(self) -> Iterator[Seen]:
        """Predicting nothing, and the set's observer where it carries one."""
        from trainers.training.score import unlearned_forces

        by_name = unlearned_forces(self.tape, self.data, "test", 0.0, self.warm_up)
        for name, forces in by_name.items():
            error = self._of(forces[self.chosen]) - self.truth
            yield self._seen(name, 0, 0.0, "none", 0, 0, error)

    def point(self, wanted: Wanted, memory: Any, past: int | None, error: FloatArray) -> Seen:
        """The errors (M,) of a predictor with this memory as one point."""
        samples = None if past is None else past + 1
        carried = sum(math.prod(shape) for shape in memory.states.values())
        history = (samples or 0) * len(self.data.observation)
        past_s = WHOLE if past is None else past / self.data.rate_hz
        kept = _FLOAT_BYTES * (carried if memory.kind == "state" else history)
        return self._seen(
            label(wanted), wanted.seed, past_s, memory.kind, samples, kept, error, wanted.hyper_text
        )

    def _seen(
        self,
        name: str,
        seed: int,
        past_s: float,
        memory: str,
        samples: int | None,
        kept_bytes: int,
        error: FloatArray,
        hyper: str = "",
    ) -> Seen:
        rmse, sd = float(np.sqrt(np.mean(error**2))), float(self.truth.std())
        r2 = r2_with_interval(self.truth, error, self.units)
        return Seen(
            self.data.domain,
            name,
            seed,
            past_s,
            memory,
            samples,
            kept_bytes,
            rmse,
            sd,
            *(r2.value, r2.low, r2.high),
            len(error),
            hyper,
        )

    def _of(self, forces: Any) -> FloatArray:
        return np.asarray(forces.double().numpy()[:, self.channel])
