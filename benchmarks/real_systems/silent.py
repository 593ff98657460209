"""What the recordings on which nothing is named can show, computed without the workflow.

`python -m benchmarks.real_systems.silent --json docs/records/silent-recordings.json` asks three
recordings by plain least squares. A pendulum's friction comes from the weak form of its equation of
motion, in which nothing noisy is differentiated (Messenger and Bortz, 2021). Of two tanks it counts
how often one was full. An actuator's valve is asked by difference equations, on folds left out.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
import numpy.typing as npt
from scipy.interpolate import UnivariateSpline

from benchmarks.real_systems.answering import recordings_of, system_of
from benchmarks.real_systems.cases import CASES
from benchmarks.records import write
from wakedeploy.core.recording import Recording
from wakedeploy.gap.systems.likelihood.logs import LogModel

FloatArray = npt.NDArray[np.float64]

WINDOWS_S = (0.4, 0.6)
_JACKKNIVES = 10
_SMOOTH = 0.0063  # rad: what a smooth curve leaves of the angle, as its gears shake
_FULL = 3  # readings at the very end of what was read: a spell
_LAGS, _FOLDS, _AHEAD = 3, 8, 10
SHARES = tuple(np.arange(0.1, 1.01, 0.05).round(2).tolist())  # of what the valve does one way


def friction(
    time_s: FloatArray, angle_rad: FloatArray, torque_nm: FloatArray, window_s: float
) -> tuple[float, float]:
    """Coulomb's friction of a pendulum and its standard error [N m].

    I θ'' + w sin θ + f sign θ' = τ, times a smooth bump of `window_s` and integrated, twice by
    parts: I ∫ φ'' θ + w ∫ φ sin θ + f ∫ φ sign θ' = ∫ φ τ for every bump. The error is that of a
    jackknife over tenths of the recording.
    """
    dt_s = float(np.median(np.diff(time_s)))
    at = np.arange(time_s[0], time_s[-1], dt_s)
    curve = UnivariateSpline(time_s, angle_rad, k=5, s=len(time_s) * _SMOOTH**2)
    angle, torque = np.interp(at, time_s, angle_rad), np.interp(at, time_s, torque_nm)
    turning = np.sign(curve.derivative()(at))
    s = np.linspace(-1.0, 1.0, round(window_s / dt_s))
    bump = (1.0 - s**2) ** 4
    bent = np.gradient(np.gradient(bump, dt_s), dt_s)
    starts = np.arange(0, len(at) - len(s), len(s) // 2)
    cuts = [slice(i, i + len(s)) for i in starts]
    rows = np.array([
        [bent @ angle[c], bump @ np.sin(angle[c]), bump @ turning[c], bump @ torque[c]]
        for c in cuts
    ])  # fmt: skip
    parts = starts * _JACKKNIVES // (starts[-1] + 1)
    without = [_least_squares(rows[parts != k])[2] for k in range(_JACKKNIVES)]
    spread = (_JACKKNIVES - 1) ** 0.5 * float(np.std(without))
    return float(_least_squares(rows)[2]), spread


def _least_squares(rows: FloatArray) -> FloatArray:
    """Coefficients of all columns but the last, which they explain."""
    return np.asarray(np.linalg.lstsq(rows[:, :-1], rows[:, -1], rcond=None)[0])


def spells(readings: FloatArray) -> list[tuple[int, int]]:
    """From where to where readings stay at the largest one, three samples at least."""
    full = np.concatenate([[False], readings == readings.max(), [False]])
    ends = np.flatnonzero(np.diff(full))
    pairs = ends.reshape(-1, 2).tolist()
    return [(a, b) for a, b in pairs if b - a >= _FULL]


def valve(pressure: FloatArray, opened: FloatArray, share: float) -> dict[str, float]:
    """A difference equation of three samples whose valve does only a `share` in the one direction.

    Root mean square of what it errs by on folds left out, one sample ahead and ten, and the log
    density of all one-sample errors at that noise [nats].
    """
    acts = np.where(opened > 0.0, opened, share * opened)
    at = np.arange(_LAGS, len(pressure))
    columns = [v[at - k] for v in (pressure, acts) for k in range(1, _LAGS + 1)]
    rows = np.column_stack([*columns, pressure[at]])
    near, far = [], []
    for fold in np.array_split(np.arange(len(at)), _FOLDS):
        theta = _least_squares(np.delete(rows, fold, axis=0))
        near.append(rows[fold, -1] - rows[fold, :-1] @ theta)
        far += [
            _simulated(theta, pressure, acts, int(begin))
            for begin in at[fold[0] : fold[-1] + 1 - _AHEAD : _AHEAD]
        ]
    next_rms, tenth_rms = (
        float(np.sqrt(np.mean(np.concatenate(each) ** 2))) for each in (near, far)
    )
    nats = -len(at) * float(np.log(next_rms))
    return {"share": share, "one_ahead": next_rms, "ten_ahead": tenth_rms, "log_density": nats}


def _simulated(theta: FloatArray, pressure: FloatArray, acts: FloatArray, begin: int) -> FloatArray:
    """Measured less simulated, from a sample on."""
    known = list(pressure[begin - _LAGS : begin])
    for t in range(begin, begin + _AHEAD):
        driven = [acts[t - k] for k in range(1, _LAGS + 1)]
        known.append(float(theta @ [*known[: -_LAGS - 1 : -1], *driven]))
    return np.asarray(pressure[begin : begin + _AHEAD] - known[_LAGS:])


def _recording(name: str) -> tuple[Any, Recording]:
    (case,) = (case for case in CASES if case.name == name)
    (recording,) = recordings_of(case, "out")
    return case, recording


def _pendulum() -> list[dict[str, float]]:
    _, log = _recording("pendulum, position control")
    given = log.time_s, log.columns["angle_rad"], log.columns["torque_nm"]
    frictions = [(window_s, *friction(*given, window_s)) for window_s in WINDOWS_S]
    return [{"window_s": w, "friction_nm": f, "error_nm": e} for w, f, e in frictions]


def _tanks() -> dict[str, Any]:
    """When the lower tank was full, and which of these times a search looks at."""
    case, log = _recording("cascaded tanks")
    model = LogModel(system_of(case, "out"), [log])
    sealed_from = model.blocks[min(model.sealed())].start
    found = spells(log.columns["level_v"])
    return {"spells": found, "searched": sum(a < sealed_from for a, _ in found)}


def _actuator() -> dict[str, Any]:
    case, log = _recording("hydraulic actuator")
    model = LogModel(system_of(case, "out"), [log])
    searched = model.blocks[min(model.sealed())].start
    pressure, opened = (log.columns[n] for n in ("pressure", "valve"))
    whole, part = (
        [valve(pressure[:n], opened[:n], share) for share in SHARES]
        for n in (len(pressure), searched)
    )
    return {"whole": whole, "searched": part, "samples": [len(pressure), searched]}


def _said(rows: Sequence[dict[str, float]]) -> str:
    plain, best = rows[-1], max(rows, key=lambda row: row["log_density"])
    gained = best["log_density"] - plain["log_density"]
    far = [row["ten_ahead"] for row in (plain, best)]
    return f"share {best['share']:g}: {gained:.1f} nats, ten ahead {far[0]:.3f} to {far[1]:.3f}"


@click.command()
@click.option("--json", "json_path", type=click.Path(path_type=Path), help="write the record here")
def main(json_path: Path | None) -> None:
    """Print what each recording shows."""
    pendulum, tanks, actuator = _pendulum(), _tanks(), _actuator()
    for row in pendulum:
        print("pendulum: {friction_nm:.2f} ± {error_nm:.2f} N m, {window_s:g} s".format(**row))
    print(f"tanks: full {tanks['spells']}, {tanks['searched']} of them searched")
    for part in ("whole", "searched"):
        print(f"actuator, {part}: {_said(actuator[part])}")
    if json_path:
        write(json_path, {"pendulum": pendulum, "tanks": tanks, "actuator": actuator})


if __name__ == "__main__":
    main()
