"""What a calibration needs, flown at the rig or on the virtual gantry by the loop of every run."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.reference import FlightPlan
from runtime.request import RunRequest, Show, Tell, Warn
from runtime.run import fly
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog, read_run_log

_ANYWHERE_M = (-20.0, 20.0)


@dataclass(frozen=True)
class Site:
    """Where to measure: a port, or with None the virtual gantry with `plant_rig` as its truth.

    Each run is recorded in `folder`. `show` is called twice a second with the seconds done and all,
    `tell` after every run that began, however it ended; `warn` gets sentences. `firmware`,
    `wall_clock` and `realtime` as in a `RunRequest`.
    """

    folder: Path
    port: str | None = None
    range_socket: Path | None = None
    plant_rig: Rig | None = None
    seed: int = 0
    firmware: bool = False
    wall_clock: bool = False
    realtime: bool | None = None
    tell: Tell | None = None
    show: Show | None = None
    warn: Warn | None = None

    def flown(
        self, name: str, rig: Rig, plan: FlightPlan, spacer_m: float = 0.0, clip_kg: float = 0.0
    ) -> RunLog:
        """The log of one run; a virtual sufferer lies on a spacer or carries a mass clipped on.

        Raises what `fly` raises; the motors are idle then.
        """
        truth = self.plant_rig or rig
        log = self.folder / f"{name}.mcap"
        if log.exists():
            raise UnusableInput(f"{log}: exists already; give another folder for the logs.")
        request = RunRequest(
            rig,
            seconds=0.0,
            seed=self.seed,
            plan=plan,
            port=self.port,
            range_socket=self.range_socket,
            plant_rig=with_clip(truth, clip_kg) if self.port is None else None,
            firmware=self.firmware,
            spacer_m=spacer_m,
            wall_clock=self.wall_clock,
            realtime=self.realtime,
            log=log,
        )
        fly(request, tell=self.tell, show=self.show, warn=self.warn)
        return read_run_log(log)


def resting(rig: Rig, seconds: float) -> tuple[Rig, FlightPlan]:
    """The rig and the plan of a run that only rests: motors off for `seconds` (at most 120).

    No height limit ends it: without motors nothing can move, and the height is not known yet.
    """
    rig = rig.changed(disturbance={"rest_s": 0.5 * seconds}, limits={"z_m": _ANYWHERE_M})
    nothing = np.empty(0)
    return rig, FlightPlan(nothing, nothing, nothing, motors_off=True)


def with_clip(rig: Rig, clip_kg: float) -> Rig:
    """The rig with a mass clipped onto the sufferer."""
    if clip_kg == 0.0:
        return rig
    return rig.changed(sufferer={"mass_kg": rig.sufferer.mass_kg + clip_kg})
