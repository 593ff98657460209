"""Study 1: the eight architectures over the domains, errors on episodes never trained on.

In: episode sets. Out: for each domain, architecture and seed RMSE and R² per force channel, beside
lines that learn nothing. Runs lie in the study's folder and are trained once: a stopped study goes
on where it was.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.episodes import EpisodeSet
from wakedeploy.study.runs import Wanted, obtained_run
from wakedeploy.study.uncertainty import FloatArray, blocks_of, r2_with_interval

MEMORYLESS = "agile-mlp"
RESERVOIRS = ({"input_scale": 0.03}, {"input_scale": 0.001, "leak": 0.3})  # beside the usual
SOURCE_ONLY = ", source's past only"
VALID = "thrust_valid"  # extra of sets whose label leans on a curve that does not hold everywhere
VALID_ONLY = "where the thrust curve holds"
PUBLISHED = {  # what is known from elsewhere, to be read beside the lines
    "fish": "The paper has R² = 0.57 without memory and 0.96 for its GRU.",
    "quadrotor": (
        "The recordings' authors tell z-RMSEs of 1.5 N below, 1.4 N above and 2.7 N swapping for "
        "their memoryless network, on other files of the same kind."
    ),
}
OBSERVER = "observer_n"  # extra of sets whose sufferer's motion tells a force without learning


@dataclass(frozen=True)
class Line:
    """One line of the table: errors per channel of one predictor on the test episodes.

    `seed` is None for what learns nothing. `groups` has the RMSE per channel of each kind of test
    episode, where the set tells kinds apart, and of samples at which its label holds. `validation`
    is the loss on validation episodes, by which the best is chosen, `wanted` the run. `normalised`
    is the root mean square over the channels of RMSE over the channel's standard deviation: 1 for
    predicting the mean.
    """

    domain: str
    predictor: str
    seed: int | None
    channels: tuple[Mapping[str, Any], ...]
    groups: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    validation: float | None = None
    wanted: Wanted | None = None

    @property
    def normalised(self) -> float:
        """RMSE over standard deviation, all channels together."""
        shares = [(c["rmse"] / c["sd"]) ** 2 for c in self.channels if c["sd"] > 0.0]
        return float(np.sqrt(np.mean(shares)))

    def as_json(self) -> dict[str, Any]:
        """The line with every number."""
        told: dict[str, Any] = {
            "domain": self.domain,
            "predictor": self.predictor,
            "seed": self.seed,
        }
        told |= {"normalised": self.normalised, "channels": [*self.channels]}
        told |= {"validation": self.validation}
        told |= {"hyper": dict(self.wanted.hyper) if self.wanted is not None else {}}
        return told | {"groups": {name: [*rmse] for name, rmse in self.groups.items()}}


def compare(
    data: EpisodeSet,
    architectures: Sequence[str],
    seeds: int,
    runs: Path,
    *,
    epochs: int | None = None,
) -> list[Line]:
    """Score everything on the same samples after one warm-up; trains what is not trained yet.

    `epochs` is how long each is trained, if not as usual.
    """
    lines = list(_unlearned(data))
    for hidden in _hidings(data):
        for arch in architectures:
            if hidden and arch == MEMORYLESS:
                continue
            name = arch + (SOURCE_ONLY if hidden else "")
            for seed in range(seeds):
                asked = _candidates(arch, seed, epochs, hidden)
                tried = [(obtained_run(data, wanted, runs), wanted) for wanted in asked]
                run, wanted = min(tried, key=lambda one: min(one[0].metrics.history))
                line = _scored(data, name, seed, *predicted(run.predictor, data))
                loss = min(run.metrics.history)
                lines.append(replace(line, validation=loss, wanted=wanted))
    return lines


def planned(
    data: EpisodeSet, architectures: Sequence[str], seeds: int, epochs: int | None = None
) -> list[Wanted]:
    """The runs that `compare` needs.

    Where a set says which channels tell of the sufferer's own motion, each model with memory has a
    second line that is kept from their past: it cannot differentiate its way to the force.
    """
    return [
        wanted
        for hidden in _hidings(data)
        for arch in architectures
        if not (hidden and arch == MEMORYLESS)
        for seed in range(seeds)
        for wanted in _candidates(arch, seed, epochs, hidden)
    ]


def _hidings(data: EpisodeSet) -> list[tuple[str, ...]]:
    named = data.provenance.get("own_motion")
    return [(), tuple(map(str, named))] if isinstance(named, list) else [()]


def _candidates(arch: str, seed: int, epochs: int | None, hidden: tuple[str, ...]) -> list[Wanted]:
    """What is tried for one line; the best on validation is taken.

    A reservoir is solved in seconds and its scale cannot be learned: driven gently it is nearly
    linear and remembers the fine differences between samples, driven hard it mixes them.
    """
    plain = Wanted(arch, seed, epochs, present_only=hidden)
    if arch != "esn" or hidden:
        return [plain]
    return [plain, *(replace(plain, hyper=hyper) for hyper in RESERVOIRS)]


def predicted(predictor: Any, data: EpisodeSet) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Truth and prediction (n, o), and the episode's number (n,), of the scored test samples."""
    from trainers.predict import predict
    from trainers.tape import lay_tape

    tape = lay_tape(data, "test", 0.0, data.warm_up_steps)
    forces = predict(predictor, tape)[tape.scored].double().numpy()
    truth = tape.force[tape.scored].double().numpy()
    return truth, forces, tape.first[tape.scored].numpy()


def _unlearned(data: EpisodeSet) -> Iterator[Line]:
    """Predicting nothing; and, where a set carries it, an observer of the sufferer's motion."""
    kept = [e for e in data.part("test") if len(e.force) > data.warm_up_steps]
    warm = data.warm_up_steps
    truth = np.concatenate([e.force[warm:] for e in kept]).astype(float)
    episode = np.concatenate([np.full(len(e.force) - warm, i) for i, e in enumerate(kept)])
    yield _scored(data, "zero", None, truth, np.zeros_like(truth), episode)
    if all(OBSERVER in e.extras for e in kept):
        told = np.concatenate([e.extras[OBSERVER][warm:] for e in kept]).astype(float)
        yield _scored(data, "no-learning observer", None, truth, told, episode)


def _scored(
    data: EpisodeSet,
    predictor: str,
    seed: int | None,
    truth: FloatArray,
    forces: FloatArray,
    episode: FloatArray,
) -> Line:
    block = blocks_of(data, episode)
    channels = []
    for i, channel in enumerate(data.force):
        error = forces[:, i] - truth[:, i]
        r2 = r2_with_interval(truth[:, i], error, block)
        channels.append(
            {
                "channel": channel.name,
                "unit": channel.unit,
                "rmse": float(np.sqrt(np.mean(error**2))),
                "sd": float(truth[:, i].std()),
                "r2": r2.value,
                "r2_low": r2.low,
                "r2_high": r2.high,
            }
        )
    return Line(
        data.domain, predictor, seed, tuple(channels), _by_group(data, forces - truth, episode)
    )


def _by_group(
    data: EpisodeSet, error: FloatArray, episode: FloatArray
) -> dict[str, tuple[float, ...]]:
    """RMSE per channel of the test episodes of each kind that the provenance names."""
    kept = [e for e in data.part("test") if len(e.force) > data.warm_up_steps]
    _, number = np.unique(episode, return_inverse=True)
    chosen = {}
    kinds = data.provenance.get("manoeuvre")
    if isinstance(kinds, dict):
        kind = np.array([str(kinds[e.name]) for e in kept])[number]
        chosen = {one: kind == one for one in sorted(set(kind))}
    if all(VALID in e.extras for e in kept):
        valid = np.concatenate([e.extras[VALID][data.warm_up_steps :] for e in kept]) > 0.5
        chosen[VALID_ONLY] = valid
    return {
        name: tuple(float(v) for v in np.sqrt(np.mean(error[at] ** 2, axis=0)))
        for name, at in chosen.items()
        if at.any()
    }


def by_predictor(lines: Sequence[Line]) -> dict[str, list[Line]]:
    """Lines of one domain by predictor, in the order in which they came."""
    found: dict[str, list[Line]] = {}
    for line in lines:
        found.setdefault(line.predictor, []).append(line)
    return found


def held_out(lines: Sequence[Line]) -> dict[str, float]:
    """Mean loss on validation of each trained predictor of a domain."""
    return {
        name: float(np.mean([line.validation for line in own if line.validation is not None]))
        for name, own in by_predictor([x for x in lines if x.validation is not None]).items()
    }


def sentence(domain: str, lines: Sequence[Line]) -> str:
    """What a domain's lines say; which model is the best is decided on validation episodes."""
    mean = {
        name: float(np.mean([line.normalised for line in own]))
        for name, own in by_predictor([line for line in lines if line.seed is not None]).items()
    }
    validation = held_out(lines)
    kept = {n: mean.pop(n) for n in list(mean) if n.endswith(SOURCE_ONLY)}
    if MEMORYLESS not in mean or len(mean) < 2:
        return f"On {domain}, {len(mean)} architectures were trained."
    plain = mean[MEMORYLESS]
    best = min(mean, key=lambda name: validation[name])
    told = _compared(domain, best, mean)
    zero = min((x.normalised for x in lines if x.predictor == "zero"), default=1.0)
    if mean[best] >= min(zero, 1.0):
        told += " It predicts no better than a constant would: nothing was learned that holds."
    return f"{told}{_of_the_source(kept, validation, mean[best], plain)}{_published(domain)}"


def _compared(domain: str, best: str, mean: Mapping[str, float]) -> str:
    plain = mean[MEMORYLESS]
    if best == MEMORYLESS:
        return (
            f"On {domain}, no memory helps: the memoryless {MEMORYLESS} is the best, with an error "
            f"of {plain:.2f} of the force's standard deviation."
        )
    beaten = sum(value < plain for value in mean.values())
    return (
        f"On {domain}, {best} is the best, with an error of {mean[best]:.2f} of the force's "
        f"standard deviation against {plain:.2f} without memory (a factor of "
        f"{plain / mean[best]:.1f}); {beaten} of {len(mean) - 1} models with memory are better "
        "than the one without."
    )


def _of_the_source(
    kept: Mapping[str, float], validation: Mapping[str, float], best: float, plain: float
) -> str:
    """How much of memory's gain is there without any past of the sufferer's place and motion."""
    if not kept:
        return ""
    name = min(kept, key=lambda one: validation[one])
    told = (
        " Kept from the past of all that the sufferer's own motion enters, its place beside the "
        f"source included, the best is {name} with {kept[name]:.2f}"
    )
    if best >= plain:
        return f"{told}."
    share = max(0.0, (plain - kept[name]) / (plain - best))
    return (
        f"{told}: at least {100 * share:.0f} % of what memory gains needs no past of the sufferer. "
        "How much of the rest is the wake's, and how much is differentiated out of that motion, "
        "these lines cannot say."
    )


def _published(domain: str) -> str:
    told = PUBLISHED.get(domain)
    return f" {told}" if told else ""
