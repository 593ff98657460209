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

from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.study.runs import Wanted, best_run, candidates
from wakedeploy.study.uncertainty import (
    R2,
    FloatArray,
    interval,
    r2_of,
    rmse_interval,
    sums,
    units_of,
)

MEMORYLESS = "agile-mlp"
ZERO = "zero"  # the line of predicting nothing
SOURCE_ONLY = ", source's past only"
VALID = "thrust_valid"  # extra of sets whose label leans on a curve that does not hold everywhere
VALID_ONLY = "where the thrust curve holds"
# Domains with one channel that counts: the others are mostly noise of the label, or there are
# none. In other domains all channels count alike.
MAIN = {"quadrotor": "force_z_n", "crazyflie": "force_z_n", "fish": "flag_tip_m"}


@dataclass(frozen=True)
class Line:
    """One line of the table: errors per channel of one predictor on the test episodes.

    `seed` is None for what learns nothing. `groups` has the RMSE per channel of each kind of test
    episode, where the set tells kinds apart, and of samples at which its label holds. `validation`
    is the loss on validation episodes, by which the best is chosen, `wanted` the run. `inputs` are
    the observation's channels. `sums` (4, U, o) are those of `uncertainty.sums`, by unit and
    channel.
    """

    domain: str
    predictor: str
    seed: int | None
    channels: tuple[Mapping[str, Any], ...]
    groups: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    validation: float | None = None
    wanted: Wanted | None = None
    inputs: tuple[str, ...] = ()
    sums: FloatArray | None = field(default=None, repr=False, compare=False)

    @property
    def normalised(self) -> float:
        """RMSE over standard deviation, all channels together: 1 for predicting the mean."""
        shares = [(c["rmse"] / c["sd"]) ** 2 for c in self.channels if c["sd"] > 0.0]
        return float(np.sqrt(np.mean(shares)))

    @property
    def main_channels(self) -> list[int]:
        """Indices of the channels that count: the domain's `MAIN`, else all that ever change."""
        names = [c.get("channel") for c in self.channels]
        if self.domain in MAIN and MAIN[self.domain] in names:
            return [names.index(MAIN[self.domain])]
        return [i for i, c in enumerate(self.channels) if c["sd"] > 0.0]

    @property
    def error(self) -> float:
        """RMSE over standard deviation of the channels that count."""
        shares = [
            (self.channels[i]["rmse"] / self.channels[i]["sd"]) ** 2 for i in self.main_channels
        ]
        return float(np.sqrt(np.mean(shares)))

    @property
    def hyper_text(self) -> str:
        """What differs from the architecture's usual hyper-parameters."""
        return "" if self.wanted is None else self.wanted.hyper_text

    def as_json(self) -> dict[str, Any]:
        """The line with every number."""
        numbers: dict[str, Any] = {
            "domain": self.domain,
            "predictor": self.predictor,
            "seed": self.seed,
        }
        numbers |= {"normalised": self.normalised, "channels": [*self.channels]}
        numbers |= {"validation": self.validation}
        numbers |= {"lead_s": self.wanted.lead_s if self.wanted is not None else None}
        numbers |= {"hyper": dict(self.wanted.hyper) if self.wanted is not None else {}}
        numbers |= {"kept_from": [*self.wanted.present_only] if self.wanted is not None else []}
        return numbers | {"groups": {name: [*rmse] for name, rmse in self.groups.items()}}


def compare(
    data: EpisodeSet,
    architectures: Sequence[str],
    seeds: int,
    runs: Path,
    *,
    epochs: int | None = None,
    blinded: bool = True,
) -> list[Line]:
    """Score everything on the same samples after one warm-up; trains what is not trained yet.

    `epochs` is how long each is trained, if not as usual. `blinded`: also kept from the sufferer's
    own past, where a set says which channels show it.
    """
    lines = list(_unlearned(data))
    for asked in _asked(data, architectures, seeds, epochs, blinded):
        run, wanted = best_run(data, asked, runs)
        line = _scored(data, label(asked), asked.seed, *predicted(run.predictor, data))
        lines.append(replace(line, validation=min(run.metrics.history), wanted=wanted))
    return lines


def planned(
    data: EpisodeSet,
    architectures: Sequence[str],
    seeds: int,
    epochs: int | None = None,
    blinded: bool = True,
) -> list[Wanted]:
    """The runs that `compare` needs."""
    asked = _asked(data, architectures, seeds, epochs, blinded)
    return [wanted for line in asked for wanted in candidates(line)]


def _asked(
    data: EpisodeSet, architectures: Sequence[str], seeds: int, epochs: int | None, blinded: bool
) -> list[Wanted]:
    """One for each line."""
    return [
        Wanted(arch, seed, epochs, present_only=hidden)
        for hidden in (hidings(data) if blinded else [()])
        for arch in architectures
        if not (hidden and arch == MEMORYLESS)
        for seed in range(seeds)
    ]


def predicted(predictor: Any, data: EpisodeSet) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Truth and prediction (n, o), and the episode's number (n,), of the scored test samples."""
    from trainers.training.predict import predict
    from trainers.training.tape import lay_tape

    tape = lay_tape(data, "test", 0.0, data.warm_up_steps)
    return _where_scored(tape, predict(predictor, tape))


def _where_scored(tape: Any, forces: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Truth, forces and episode's number where a tape is scored; from `forces` (N, o) of it all."""
    truth, forecast = (x[tape.scored].double().numpy() for x in (tape.force, forces))
    return truth, forecast, tape.first[tape.scored].numpy()


def hidings(data: EpisodeSet) -> list[tuple[str, ...]]:
    """What is hidden from a model's past: nothing, and the channels of the sufferer's own motion.

    The second only where a set names them. Without them nothing can differentiate its way to the
    force.
    """
    named = data.provenance.get("own_motion")
    return [(), tuple(map(str, named))] if isinstance(named, list) else [()]


def label(wanted: Wanted) -> str:
    """How a run's line is called."""
    return wanted.arch + (SOURCE_ONLY if wanted.present_only else "")


def _unlearned(data: EpisodeSet) -> Iterator[Line]:
    """Predicting nothing; and, where a set carries it, an observer of the sufferer's motion."""
    from trainers.training.score import unlearned_forces
    from trainers.training.tape import lay_tape

    tape = lay_tape(data, "test", 0.0, data.warm_up_steps)
    for name, forces in unlearned_forces(tape, data, "test", 0.0, data.warm_up_steps).items():
        yield _scored(data, name, None, *_where_scored(tape, forces))


def _scored(
    data: EpisodeSet,
    predictor: str,
    seed: int | None,
    truth: FloatArray,
    forces: FloatArray,
    episode: FloatArray,
) -> Line:
    unit = units_of(data, episode)
    channels, by_unit = [], []
    for i, channel in enumerate(data.force):
        error = forces[:, i] - truth[:, i]
        by_unit.append(sums(truth[:, i], error, unit))
        r2, rmse = r2_of(by_unit[-1][None]), rmse_interval(by_unit[-1][None])
        channels.append(
            {
                "channel": channel.name,
                "unit": channel.unit,
                "rmse": float(np.sqrt(np.mean(error**2))),
                "rmse_low": None if rmse is None else rmse[0],
                "rmse_high": None if rmse is None else rmse[1],
                "sd": float(truth[:, i].std()),
                "r2": r2.value,
                "r2_low": r2.low,
                "r2_high": r2.high,
            }
        )
    return Line(
        data.domain,
        predictor,
        seed,
        tuple(channels),
        _by_group(data, forces - truth, episode),
        inputs=tuple(channel.name for channel in data.observation),
        sums=np.stack(by_unit, -1),
    )


def _by_group(
    data: EpisodeSet, error: FloatArray, episode: FloatArray
) -> Mapping[str, tuple[float, ...]]:
    """RMSE per channel of each kind of episode, where the set's provenance has them."""
    kinds = data.provenance.get("manoeuvre")
    number = np.unique(episode, return_inverse=True)[1]
    kept = [e for e in data.part("test") if len(e.force) > data.warm_up_steps]
    chosen: dict[str, Any] = {}
    if isinstance(kinds, dict):
        kind = np.array([str(kinds[e.name]) for e in kept])[number]
        chosen = {kind_name: kind == kind_name for kind_name in sorted(set(kind))}
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
        name: float(np.mean([line.validation for line in runs if line.validation is not None]))
        for name, runs in by_predictor([x for x in lines if x.validation is not None]).items()
    }


def errors(lines: Sequence[Line]) -> dict[str, float]:
    """Mean error over the seeds of each trained predictor of a domain."""
    trained = by_predictor([line for line in lines if line.seed is not None])
    return {name: float(np.mean([line.error for line in runs])) for name, runs in trained.items()}


def r2_over_seeds(lines: Sequence[Line], channel: int) -> R2:
    """The mean R² of a channel over one predictor's lines, with its interval over the units."""
    by_unit = [line.sums[..., channel] for line in lines if line.sums is not None]
    if not by_unit:
        return R2(float(np.mean([line.channels[channel]["r2"] for line in lines])), None, None)
    return r2_of(np.array(by_unit))


def change(lines: Sequence[Line], base: Sequence[Line]) -> tuple[float, float] | None:
    """By what share the mean error of some lines lies above that of others, a 90 % interval.

    Below 0 they err less. The same units are drawn for both: what is hard for one is hard for all.
    None where there are too few.
    """
    both = [
        np.array([line.sums for line in side]) for side in (lines, base) if side[0].sums is not None
    ]
    if len(both) < 2:
        return None
    main = lines[0].main_channels

    def of(times: FloatArray) -> FloatArray:
        mean = []
        for by_unit in both:  # (S, 4, U, o)
            count, total, squares, errors = np.moveaxis(
                np.einsum("skuo,du->skdo", by_unit[..., main], times), 1, 0
            )
            lost = errors / (squares - total**2 / count)  # (S, D, o)
            mean.append(np.sqrt(lost.mean(-1)).mean(0))
        return np.asarray(np.log(mean[0] / mean[1]))

    found = interval(of, both[0].shape[2])
    return None if found is None else (float(np.expm1(found[0])), float(np.expm1(found[1])))
