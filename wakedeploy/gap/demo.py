"""The paper's own missing effect, found: motors that lag, and a rig file that says they do not.

In: a folder. Out: in it a rig file without spool lag, flights of a virtual gantry that has it, the
workflow's folder `gap` with the corrected rig, two predictors, `demo.json`, one picture of it all.
"""

import functools
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import finite
from wakedeploy.core.parallel import parallel_map
from wakedeploy.core.rig import Rig
from wakedeploy.domains.gantry import record
from wakedeploy.gap.progress import Progress, StepsDone, quiet, uncounted
from wakedeploy.gap.report.demo_figure import Flown, draw_story
from wakedeploy.gap.systems.gantry.findings import Effect, Retraining
from wakedeploy.gap.systems.gantry.folder import read_steps
from wakedeploy.gap.systems.gantry.retraining import FlownAgain, Pilot, fly_both, retrain
from wakedeploy.gap.systems.gantry.workflow import close
from wakedeploy.rig.file import default_rig, read_rig

HIDDEN = ("spool-lag-source", "spool-lag-sufferer")
PICTURE = "gap-demo-story.png"
_FIRST_SEED = 2026  # of the measured flights; training episodes count from a million
_FIRST_TEST_SEED = 910_000_000


@dataclass(frozen=True)
class Size:
    """How much is flown and trained: measured flights, flights per pilot at the end."""

    flights: int
    seconds: float
    minutes: float
    epochs: int
    test_flights: int


FULL = Size(flights=7, seconds=20.0, minutes=8.0, epochs=25, test_flights=6)
QUICK = Size(flights=5, seconds=16.0, minutes=3.0, epochs=15, test_flights=2)


@dataclass(frozen=True)
class Story:
    """What the demo came to: `demo.json`.

    `tracking` and `picture` are None where no rig file was corrected.
    """

    verdict: str | None
    effects: list[Effect]
    tracking: FlownAgain | None
    picture: Path | None
    seconds: float

    @property
    def ok(self) -> bool:
        """Whether exactly the hidden effects were named and tracking got better with them."""
        named = {effect.name for effect in self.effects}
        if self.verdict != "named" or named != set(HIDDEN) or self.tracking is None:
            return False
        flown = self.tracking.feedforward
        return (flown.after.rmse or math.inf) < (flown.before.rmse or math.inf)

    def as_json(self) -> dict[str, Any]:
        """As the file has it."""
        return {
            "verdict": self.verdict,
            "tracking": self.tracking and asdict(self.tracking),
            "picture": self.picture and str(self.picture),
            "effects": [finite(e.model_dump(mode="json", by_alias=True)) for e in self.effects],
            "ok": self.ok,
            "seconds": round(self.seconds, 1),
        }


def world_rig() -> Rig:
    """What the virtual gantry is: the default rig, whose motors lag by 60 ms up and 100 ms down."""
    return default_rig()


def believed_rig() -> Rig:
    """What the rig file says: the same without spool lag, so that motors follow at once."""
    return world_rig().without("spool")


def hidden_values() -> dict[str, float]:
    """What the world has and the rig file lacks, by `<effect>.<parameter>` [s]."""
    spool = world_rig().spool
    return {
        f"{name}.{end}": getattr(lag, end)
        for name, lag in zip(HIDDEN, (spool.source, spool.sufferer), strict=True)
        for end in ("up_s", "down_s")
    }


def run(out: Path, size: Size = FULL, *, workers: int = 2, progress: Progress = quiet) -> Story:
    """Tell the whole story.

    Nothing after the flights looks at the world's rig until they are flown again.
    """
    began = time.monotonic()
    rig_path = out / "rig.toml"
    logs = [out / f"flight{i + 1}.mcap" for i in range(size.flights)]
    _refuse_foreign(rig_path, logs)
    out.mkdir(parents=True, exist_ok=True)
    believed_rig().write(rig_path)
    stage = f"flying {size.flights} flights of a virtual gantry whose motors lag"
    progress(stage)
    fly_measured(logs, size, workers, functools.partial(progress, stage))
    folder = out / "gap"

    def retrained(old: Rig, new: Rig, scored: Sequence[Path], into: Path) -> Retraining:
        return retrain(
            old, new, scored, into / "retrain", minutes=size.minutes, epochs=size.epochs,
            workers=workers, progress=progress,
        )  # fmt: skip

    result = close(rig_path, logs, folder, workers=workers, progress=progress, retrain=retrained)
    tracking = picture = None
    if read_steps(folder).add is not None:
        tracking = _flown_again(out, read_rig(folder / "rig.toml"), size, workers, progress)
        picture = out / PICTURE
    seconds = time.monotonic() - began
    return Story(result.verdict, list(result.effects), tracking, picture, seconds)


def _refuse_foreign(rig_path: Path, logs: Sequence[Path]) -> None:
    """UnusableInput where somebody's own rig file or flights have the names of the demo's."""
    if rig_path.is_file() and rig_path.read_text(encoding="utf-8") == believed_rig().text:
        return  # an earlier demo's folder
    for path in (rig_path, *logs):
        if path.exists():
            raise UnusableInput(
                f"{path}: not the demo's, which would replace it; give another --out."
            )


def fly_measured(
    logs: Sequence[Path], size: Size, workers: int, steps: StepsDone = uncounted
) -> None:
    """Flights of the world under the uncorrected rig file, PID alone, as logs without truth."""
    jobs = [(path, size.seconds, index) for index, path in enumerate(logs)]
    parallel_map(_measured, jobs, workers=workers, steps=steps)


def _measured(job: tuple[Path, float, int]) -> None:
    path, seconds, index = job
    log = record(world_rig(), seconds=seconds, seed=_FIRST_SEED + index, model_rig=believed_rig())
    log.metadata["rig_file"] = "rig.toml"  # as beside the flights
    log.without_truth().write_mcap(path)


def _flown_again(
    out: Path, corrected: Rig, size: Size, workers: int, progress: Progress
) -> FlownAgain:
    """Tracking on the world that still hides the effect, and the picture."""
    folder = out / "gap"
    before = Pilot(believed_rig(), folder / "retrain" / "old.onnx")
    after = Pilot(corrected, folder / "retrain" / "new.onnx")
    seeds = [_FIRST_TEST_SEED + i for i in range(size.test_flights)]
    stage = "flying with either rig and predictor, on the gantry that still lags"
    progress(stage)
    steps = functools.partial(progress, stage)
    flown = (world_rig(), before, after, seeds)
    tracking = fly_both(*flown, seconds=size.seconds, workers=workers, steps=steps)
    progress("drawing the story")
    old, new = (_example(pilot, seeds[0], size.seconds) for pilot in (before, after))
    draw_story(read_steps(folder), tracking, old, new, hidden_values(), out / PICTURE)
    return tracking


def _example(pilot: Pilot, seed: int, seconds: float) -> Flown:
    log = record(
        world_rig(), seconds=seconds, seed=seed, package=pilot.package, model_rig=pilot.rig
    )
    flying = log.flying
    error_mm = 1e3 * (log["true_z_m"] - log["z_ref_m"])[flying]
    return Flown(log["t_s"][flying] - log["t_s"][flying][0], error_mm)


def effect_lines(rig_path: Path) -> str:
    """The rig file's entries for effects, as they stand in it, hashes shortened."""
    text = rig_path.read_text(encoding="utf-8")
    start = text.find("[[effect]]")
    return text[start:].rstrip() if start >= 0 else ""
