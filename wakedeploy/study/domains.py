"""Study 1: the eight architectures over the domains, errors on episodes never trained on.

In: episode sets. Out: for each domain, architecture and seed RMSE and R² per force channel, beside
lines that learn nothing. Runs lie in the study's folder and are trained once: a stopped study goes
on where it was.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.episodes import EpisodeSet
from wakedeploy.study.runs import Wanted, obtained
from wakedeploy.study.uncertainty import FloatArray, blocks, r2_with_interval

MEMORYLESS = "agile-mlp"
SOURCE_ONLY = ", source's past only"
OBSERVER = "observer_n"  # extra of sets whose sufferer's motion tells a force without learning
_BLOCK_WINDOWS = 4.0  # a block of the bootstrap, in windows


@dataclass(frozen=True)
class Line:
    """One line of the table: errors per channel of one predictor on the test episodes.

    `seed` is None for what learns nothing. `groups` has the RMSE per channel of each kind of test
    episode, where the set tells kinds apart. `normalised` is the root mean square over the channels
    of RMSE over the channel's standard deviation: 1 for predicting the mean.
    """

    domain: str
    predictor: str
    seed: int | None
    channels: tuple[Mapping[str, Any], ...]
    groups: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

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
    for wanted in planned(data, architectures, seeds, epochs):
        name = wanted.arch + (SOURCE_ONLY if wanted.present_only else "")
        forces = predicted(obtained(data, wanted, runs), data)
        lines.append(_scored(data, name, wanted.seed, *forces))
    return lines


def planned(
    data: EpisodeSet, architectures: Sequence[str], seeds: int, epochs: int | None = None
) -> list[Wanted]:
    """The runs that `compare` scores, in the order of its lines.

    Where a set says which channels tell of the sufferer's own motion, each model with memory has a
    second line that is kept from their past: it cannot differentiate its way to the force.
    """
    plain = [Wanted(a, s, epochs) for a in architectures for s in range(seeds)]
    named = data.provenance.get("own_motion")
    if not isinstance(named, list):
        return plain
    hidden = tuple(map(str, named))
    kept = [w for w in plain if w.arch != MEMORYLESS]
    return plain + [Wanted(w.arch, w.seed, epochs, present_only=hidden) for w in kept]


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
    length = max(1, round(_BLOCK_WINDOWS * data.window_s * data.rate_hz))
    block = blocks(np.asarray(episode, np.int64), length)
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
    kinds = data.provenance.get("manoeuvre")
    if not isinstance(kinds, dict):
        return {}
    kept = [e.name for e in data.part("test") if len(e.force) > data.warm_up_steps]
    _, number = np.unique(episode, return_inverse=True)
    kind = np.array([str(kinds[name]) for name in kept])[number]
    squares = {one: np.mean(error[kind == one] ** 2, axis=0) for one in sorted(set(kind))}
    return {one: tuple(float(v) for v in np.sqrt(mean)) for one, mean in squares.items()}


def by_predictor(lines: Sequence[Line]) -> dict[str, list[Line]]:
    """Lines of one domain by predictor, in the order in which they came."""
    found: dict[str, list[Line]] = {}
    for line in lines:
        found.setdefault(line.predictor, []).append(line)
    return found


def sentence(domain: str, lines: Sequence[Line]) -> str:
    """What a domain's lines say, in one sentence, or two where own motion was hidden."""
    mean = {
        name: float(np.mean([line.normalised for line in own]))
        for name, own in by_predictor([line for line in lines if line.seed is not None]).items()
    }
    kept = {n: mean.pop(n) for n in list(mean) if n.endswith(SOURCE_ONLY)}
    if MEMORYLESS not in mean or len(mean) < 2:
        return f"On {domain}, {len(mean)} architectures were trained."
    plain = mean[MEMORYLESS]
    best = min(mean, key=lambda name: mean[name])
    if best == MEMORYLESS:
        return (
            f"On {domain}, no memory helps: the memoryless {MEMORYLESS} has the least error, "
            f"{plain:.2f} of the force's standard deviation."
        )
    beaten = sum(value < plain for value in mean.values())
    told = (
        f"On {domain}, {best} has the least error, {mean[best]:.2f} of the force's standard "
        f"deviation against {plain:.2f} without memory (a factor of {plain / mean[best]:.1f}); "
        f"{beaten} of {len(mean) - 1} models with memory are better than the one without."
    )
    return told + _of_the_source(kept, mean[best], plain)


def _of_the_source(kept: Mapping[str, float], best: float, plain: float) -> str:
    """How much of memory's gain is left without the past of the sufferer's own motion."""
    if not kept:
        return ""
    name = min(kept, key=lambda one: kept[one])
    share = (plain - kept[name]) / (plain - best)
    return (
        f" Without the past of the sufferer's own motion the best is {name} with {kept[name]:.2f}: "
        f"{100 * share:.0f} % of what memory gains is the wake's, the rest a model can "
        "differentiate out of that motion."
    )
