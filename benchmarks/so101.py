"""What each joint of a small arm lacks, found in its public motions, and what that is worth.

`python -m benchmarks.so101` asks the gap workflow about the six joints of an SO-101, each a servo
of second order, on the first minute of two motions that move all joints. Every other motion in
which a joint moves is replayed from its commands alone: by the command itself, by a servo fitted in
the usual way (least squares of the replay), and by the servo with what was named. Answers are kept
in the folder `--out`, a joint each; `--json` writes the record when all are there. The arm's MJCF
is not among the recordings, so that each joint stands alone: a weight that turns with other joints
is not in it.
"""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np
import numpy.typing as npt
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, lfilter, ss2tf

from benchmarks.real_systems.answering import EXAMPLES, kept_of, recordings_folder
from benchmarks.records import COMMIT, write
from wakedeploy.core.files import json_of, json_text, text_of, write_text_whole
from wakedeploy.core.recording import Recording
from wakedeploy.domains.tables.columns import read_columns
from wakedeploy.domains.tables.reading import read_recordings
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.results import answer_of
from wakedeploy.gap.systems.correction import correction_of, write_correction
from wakedeploy.gap.systems.files import read_system
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.own_system import System

JOINTS = ("rotation", "pitch", "elbow", "wrist_pitch", "wrist_roll", "jaw")
TRAINED = ("prbs_excitation", "trapezoidal_profile")
SHOWN = ("elbow", "random_waypoints", 0, 700)  # joint, motion and samples of the figure
_MINUTE = 3000  # samples of each motion that the search sees
_STILL_RAD = 0.03  # a joint whose command varies less does not move
_LEADING = 6
FloatArray = npt.NDArray[np.float64]


def told_of(joint: str, out: Path) -> dict[str, Any]:
    """Everything about one joint, as plain numbers."""
    began_s = time.process_time()
    system = read_system(EXAMPLES / "so101.py")
    trained = [begun(recording_of(system, joint, name)) for name in TRAINED]
    model = LogModel(system, trained)
    base = fitted_base(model)
    answer = named(model, base)
    document = answer_of(answer)
    answer_json = document.as_json()
    correction = out / f"{joint}.toml"
    write_correction(correction_of(model, answer.found), correction)
    seconds = time.process_time() - began_s
    better = type(system).corrected(correction)
    plain = fitted_servo(trained)
    kept = {
        key: answer_json[key] for key in ("verdict", "class", "effects", "unsettled", "constants")
    }
    return kept | {
        "joint": joint,
        "threshold_nats": document.threshold_nats,
        "leading": [kept_of(ranked) for ranked in document.rounds[0].ranking[:_LEADING]],
        "plain_servo": {"stiffness_per_s2": plain[0], "damping_per_s": plain[1]},
        "replays": {
            recording.name: _replay(recording, plain, better)
            for recording in _unseen(system, joint)
        },
        "shown": _shown(system, joint, plain, better),
        "seconds": seconds,
        "samples": sum(log.outputs.shape[1] for log in model.logs),
    }


def fitted_servo(recordings: Sequence[Recording]) -> tuple[float, float]:
    """Stiffness and damping by least squares of the replay: what people do first."""

    def off(logs: FloatArray) -> FloatArray:
        parts = [r.columns["angle_rad"] - servo(r, *np.exp(logs)) for r in recordings]
        errors = np.concatenate(parts)
        return errors[np.isfinite(errors)]  # some ticks have no new sample

    starts = [np.log(s) for s in ((400.0, 40.0), (2000.0, 90.0), (150.0, 15.0))]
    fits = [least_squares(off, s, diff_step=1e-3, max_nfev=50) for s in starts]
    stiffness, damping = np.exp(min(fits, key=lambda f: float(f.cost)).x)
    return float(stiffness), float(damping)


def servo(recording: Recording, stiffness: float, damping: float) -> FloatArray:
    """A servo's angle (n,) along its command, from the first measured angle at rest, exactly."""
    a = np.array([[0.0, 1.0], [-stiffness, -damping]])
    b, c = np.array([[0.0], [stiffness]]), np.array([[1.0, 0.0]])
    dt_s = 1.0 / recording.rate_hz
    phi, gamma, *_ = cont2discrete((a, b, c, np.zeros((1, 1))), dt_s)
    above, below = ss2tf(phi, gamma, c, np.zeros((1, 1)))
    command, first = recording.columns["command_rad"], recording.columns["angle_rad"][0]
    forced = lfilter(above[0], below, command - first)
    return np.asarray(first + forced)


def _replay(recording: Recording, plain: tuple[float, float], better: System) -> dict[str, float]:
    """Root mean square of measured less replayed [rad], by what replays."""
    measured = recording.columns["angle_rad"]
    replayed = {
        "command": recording.columns["command_rad"],
        "plain": servo(recording, *plain),
        "corrected": better.simulate(recording)["angle_rad"],
    }
    return {n: float(np.sqrt(np.nanmean((measured - v) ** 2))) for n, v in replayed.items()}


def _shown(
    system: System, joint: str, plain: tuple[float, float], better: System
) -> dict[str, list[float]]:
    """A stretch of an unseen motion for the figure, of one joint."""
    of, motion, start, stop = SHOWN
    if joint != of:
        return {}
    recording = recording_of(system, joint, motion)
    series = {
        "time_s": recording.time_s,
        "command": recording.columns["command_rad"],
        "measured": recording.columns["angle_rad"],
        "plain": servo(recording, *plain),
        "corrected": better.simulate(recording)["angle_rad"],
    }
    return {n: [round(float(v), 5) for v in values[start:stop]] for n, values in series.items()}


def begun(recording: Recording) -> Recording:
    """Its first minute."""
    columns = {name: values[:_MINUTE] for name, values in recording.columns.items()}
    return Recording(recording.name, recording.time_s[:_MINUTE], columns)


def _unseen(system: System, joint: str) -> list[Recording]:
    """Motions that took no part in the search and move the joint."""
    names = sorted(p.stem for p in (recordings_folder() / "so101").glob("*.npz"))
    read = [recording_of(system, joint, name) for name in names if name not in TRAINED]
    return [
        recording for recording in read if np.std(recording.columns["command_rad"]) > _STILL_RAD
    ]


def recording_of(system: System, joint: str, motion: str) -> Recording:
    """A joint's commands and angles in a motion."""
    units = {i.name: i.unit for i in system.inputs} | {o.name: o.unit for o in system.outputs}
    columns = read_columns(EXAMPLES / f"so101_{joint}.toml")
    (recording,) = read_recordings(
        [recordings_folder() / "so101" / f"{motion}.npz"], columns, units
    ).recordings
    return Recording(motion, recording.time_s, recording.columns)


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=Path("runs/so101"))
@click.option("--joint", "chosen", multiple=True, type=click.Choice(JOINTS))
@click.option("--json", "record", type=click.Path(path_type=Path), help="write the record here")
def main(out: Path, chosen: tuple[str, ...], record: Path | None) -> None:
    """Ask about each joint, print the answer, write the record once all are there."""
    out.mkdir(parents=True, exist_ok=True)
    by_joint: dict[str, Any] = {}
    for joint in JOINTS:
        kept = out / f"{joint}-{COMMIT[:12]}.json"
        if not kept.exists() and (not chosen or joint in chosen):
            write_text_whole(kept, json_text(told_of(joint, out)))
        if kept.exists():
            by_joint[joint] = json_of(text_of(kept))
            names = ", ".join(e["name"] for e in by_joint[joint]["effects"]) or "nothing"
            click.echo(f"{joint}: {by_joint[joint]['verdict']}: {names}")
    if record is not None and len(by_joint) == len(JOINTS):
        write(record, {"trained": TRAINED, "joints": by_joint})


if __name__ == "__main__":
    main()
