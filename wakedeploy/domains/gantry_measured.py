"""Gantry episodes from real flights: what was observed, and the force measured after the fact.

In: run logs and the rig. Out: an episode set whose force is the smoothed disturbance, and what each
log gave. Extra arrays: the force's standard deviation `force_sd_n`, and what it was found from,
`acceleration_mps2` and `thrust_n` (after spool); `t_s` is the log's time. Nothing that only a
simulation knows is looked at.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from pydantic import JsonValue

from runtime.loop.pilot import FORCE, OBSERVATION, observation
from runtime.measured_force import MeasuredForce, measure, range_offset
from runtime.smoother import ForceModel
from wakedeploy.core.episodes import SPLITS, Channel, Episode, EpisodeSet
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.core.version import VERSION
from wakedeploy.domains.gantry import WINDOW_S
from wakedeploy.physics.effects.chain import default_lead_s

HELD_OUT = 0.15  # of the files, or of a stretch's time, for validation and as much for test
# How a stretch is cut where there are too few files: the test lies in mid-flight, because landing,
# which comes last, meets little wake.
_BLOCKS = (("train", 0.35), ("test", HELD_OUT), ("train", 0.35), ("validation", HELD_OUT))
_SHORTEST_BLOCK_S = 2.0 * WINDOW_S

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class LogReport:
    """What one log gave."""

    name: str
    seconds: float
    outliers: int
    range_offset_m: float
    force_rms_n: float
    force_sd_n: float  # root mean square
    note: str


@dataclass(frozen=True, eq=False)
class MeasuredSet:
    """The set, the fitted model, and a report for each log."""

    episodes: EpisodeSet
    model: ForceModel
    reports: tuple[LogReport, ...]

    @property
    def r2_ceiling(self) -> float:
        """The R² that a perfect predictor would reach on all labels: 1 − mean(sd²) / var(force)."""
        force = np.concatenate([e.force for e in self.episodes.episodes])
        sd = np.concatenate([e.extras["force_sd_n"] for e in self.episodes.episodes])
        return float(1.0 - np.mean(np.square(sd)) / np.var(force))


def measured_set(
    logs: Mapping[str, RunLog],
    rig: Rig,
    sources: Mapping[str, str] | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> MeasuredSet:
    """Smooth the logs, by name, and make an episode set of their airborne stretches.

    Three files or more are split by file, fewer by blocks of time. `sources` (name → hash of the
    file) goes into the provenance. Raises UnusableInput for logs of different rates, and when too
    little was flown.
    """
    plain = {name: log.without_truth() for name, log in logs.items()}
    rate_hz = _common_rate(plain)
    model, measured = _measured(plain, rig, progress)
    found = _stretches(plain, measured, rig)
    episodes, split = _split(found, rate_hz)
    reports = [_report(name, log, measured[name], rig) for name, log in plain.items()]
    made = EpisodeSet(
        domain="gantry",
        rate_hz=rate_hz,
        observation=tuple(Channel(name, unit) for name, unit in OBSERVATION),
        force=tuple(Channel(name, unit) for name, unit in FORCE),
        window_s=WINDOW_S,
        loss_weights=(1.0,),
        split=split,
        episodes=episodes,
        provenance=_provenance(rig, model, reports, sources or {}),
    )
    return MeasuredSet(made, model, tuple(reports))


def measured_stretches(logs: Mapping[str, RunLog], rig: Rig) -> dict[str, list[Episode]]:
    """The airborne stretches of each log, whole, with the force that was measured in them.

    For scoring what was trained elsewhere; raises UnusableInput for logs of different rates.
    """
    plain = {name: log.without_truth() for name, log in logs.items()}
    _common_rate(plain)
    return _stretches(plain, _measured(plain, rig)[1], rig)


def _measured(
    logs: Mapping[str, RunLog],
    rig: Rig,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[ForceModel, dict[str, list[MeasuredForce]]]:
    model, measured = measure(list(logs.values()), rig, progress)
    return model, dict(zip(logs, measured, strict=True))


def _stretches(
    logs: Mapping[str, RunLog], measured: Mapping[str, Sequence[MeasuredForce]], rig: Rig
) -> dict[str, list[Episode]]:
    return {
        name: [_episode(f"{name}-{i}", log, one, rig) for i, one in enumerate(measured[name], 1)]
        for name, log in logs.items()
    }


def episode_name(stem: str) -> str:
    """A file's name as an episode may be called."""
    return re.sub(r"[^A-Za-z0-9._-]+", "-", stem).strip("-._")[:80] or "flight"


def _common_rate(logs: Mapping[str, RunLog]) -> float:
    rates = {name: log.rate_hz for name, log in logs.items() if len(log) > 1}
    if not rates:
        raise UnusableInput("The logs hold no ticks; there is nothing to smooth.")
    first, rate_hz = next(iter(rates.items()))
    # A rate that no metadata states comes from a median step, good to a per mille.
    for name, other in rates.items():
        if abs(other - rate_hz) > 2e-3 * rate_hz:
            raise UnusableInput(
                f"{name} was flown at {other:g} Hz, {first} at {rate_hz:g} Hz; smooth them apart."
            )
    stated = [float(log.metadata["rate_hz"]) for log in logs.values() if "rate_hz" in log.metadata]
    return stated[0] if stated else round(rate_hz, 2)


def _episode(name: str, log: RunLog, one: MeasuredForce, rig: Rig) -> Episode:
    extras = {
        "force_sd_n": one.force_sd_n[:, None],
        "acceleration_mps2": one.acceleration_mps2,
        "thrust_n": one.thrust_n,
        "t_s": log["t_s"][one.ticks],
    }
    return Episode(
        name,
        _observations(log, one, rig),
        one.force_n.astype(np.float32)[:, None],
        {key: array.astype(np.float32) for key, array in extras.items()},
    )


def _observations(log: RunLog, one: MeasuredForce, rig: Rig) -> npt.NDArray[np.float32]:
    """What the predictor saw, (T, 5): causal estimates, never smoothed ones.

    A smoothed speed knows the force that is to be predicted from it. Where the log has no
    estimates, those of the forward filter stand in.
    """
    x_m = _logged(log, "x_m", one, (log["steps"][one.ticks] + 0.5) / rig.stepper.steps_per_m)
    vx_mps = _logged(log, "vx_mps", one, _backward_speed(log["t_s"][one.ticks], x_m))
    z_m = _logged(log, "z_est_m", one, one.smoothed.causal_height_m)
    vz_mps = _logged(log, "vz_est_mps", one, one.smoothed.causal_speed_mps)
    ticks = zip(x_m, z_m, vx_mps, vz_mps, log["source_cmd_us"][one.ticks], strict=True)
    return np.stack([observation(rig, *values) for values in ticks])


def _logged(log: RunLog, name: str, one: MeasuredForce, otherwise: FloatArray) -> FloatArray:
    logged = log[name][one.ticks]
    return np.where(np.isfinite(logged), logged, otherwise)


def _backward_speed(t_s: FloatArray, x_m: FloatArray) -> FloatArray:
    """Speed from the last three steps, so that one step of the motor is no jump."""
    back = np.maximum(np.arange(len(t_s)) - 3, 0)
    span_s = np.maximum(t_s - t_s[back], 1e-9)
    return np.asarray((x_m - x_m[back]) / span_s)


def _split(
    found: Mapping[str, Sequence[Episode]], rate_hz: float
) -> tuple[tuple[Episode, ...], dict[str, str]]:
    """Episodes and the split they belong to: by file from three files on, else by time."""
    flown = [name for name, episodes in found.items() if episodes]
    if len(flown) >= len(SPLITS):
        splits = dict(zip(flown, _file_splits(len(flown)), strict=True))
        split = {e.name: splits[name] for name in flown for e in found[name]}
        return tuple(e for name in flown for e in found[name]), split
    blocks = [block for name in flown for e in found[name] for block in _blocks(e, rate_hz)]
    if not any(where == "test" for _, where in blocks):
        raise UnusableInput(
            f"Fewer than {len(SPLITS)} files with less than {_SHORTEST_BLOCK_S / HELD_OUT:.0f} s "
            "in the air at a stretch cannot be split; fly longer or more often."
        )
    return tuple(e for e, _ in blocks), {e.name: where for e, where in blocks}


def _file_splits(count: int) -> list[str]:
    """For each file its split, at least one in each, spread over the order of flying."""
    held_out = max(1, round(HELD_OUT * count))
    splits = ["train"] * count
    spread = np.linspace(0, count, 2 * held_out + 1)[1:].astype(int) - 1
    for place, where in zip(spread, ("validation", "test") * held_out, strict=True):
        splits[place] = where
    return splits


def _blocks(episode: Episode, rate_hz: float) -> list[tuple[Episode, str]]:
    """An episode cut into the splits' blocks; whole into train when it is too short."""
    total = len(episode)
    if HELD_OUT * total / rate_hz < _SHORTEST_BLOCK_S:
        return [(episode, "train")]
    ends = np.round(np.cumsum([share for _, share in _BLOCKS]) * total).astype(int)
    starts = np.concatenate([[0], ends[:-1]])
    return [
        (_part(episode, slice(start, end), f"{episode.name}-{n}"), where)
        for n, ((where, _), start, end) in enumerate(zip(_BLOCKS, starts, ends, strict=True), 1)
    ]


def _part(episode: Episode, span: slice, name: str) -> Episode:
    extras = {key: array[span] for key, array in episode.extras.items()}
    return Episode(name, episode.observation[span], episode.force[span], extras)


def _report(name: str, log: RunLog, of_log: Sequence[MeasuredForce], rig: Rig) -> LogReport:
    force = np.concatenate([one.force_n for one in of_log]) if of_log else np.array([np.nan])
    sd = np.concatenate([one.force_sd_n for one in of_log]) if of_log else np.array([np.nan])
    return LogReport(
        name=name,
        seconds=float(sum(log["t_s"][o.ticks[-1]] - log["t_s"][o.ticks[0]] for o in of_log)),
        outliers=sum(one.smoothed.rejected for one in of_log),
        range_offset_m=range_offset(log, rig) if len(log) else 0.0,
        force_rms_n=float(np.sqrt(np.mean(np.square(force)))),
        force_sd_n=float(np.sqrt(np.mean(np.square(sd)))),
        note=_note(log, of_log, rig),
    )


def _note(log: RunLog, of_log: Sequence[MeasuredForce], rig: Rig) -> str:
    notes = []
    if not of_log:
        notes.append("nothing airborne")
    if log.metadata.get("rig_sha256", rig.sha256) != rig.sha256:
        notes.append("flown with another rig file")
    if log.metadata.get("unfinished"):
        notes.append("recording cut off")
    if not (log.has("applied_time_s") and log.has("sufferer_applied_us")):
        notes.append("no applied pulses: commands and the rig's latency used")
    return "; ".join(notes)


def _provenance(
    rig: Rig, model: ForceModel, reports: Sequence[LogReport], sources: Mapping[str, str]
) -> dict[str, JsonValue]:
    told = [
        {key: None if value != value else value for key, value in vars(report).items()}
        for report in reports
    ]
    return {
        "made_by": f"wakedeploy {VERSION} log smooth",
        "sources": [row | {"sha256": sources.get(str(row["name"]))} for row in told],
        "force_model": vars(model),
        "rig_sha256": rig.sha256,
        "rig_toml": rig.text,
        "default_lead_s": default_lead_s(rig),
    }
