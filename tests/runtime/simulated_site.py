"""A place to calibrate in simulated time: the rig's loop around the plant, without waiting."""

from dataclasses import dataclass

from runtime.calibration.session import with_clip
from runtime.loop.loop import Loop
from runtime.reference import FlightPlan
from runtime.simulated import SimulatedGantry
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.core.runlog_columns import STAGES
from wakedeploy.physics.gantry import GantryPlant

_FLOWN: dict[tuple[object, ...], RunLog] = {}


class Rows:
    error: str | None = None

    def __init__(self) -> None:
        self.rows: list = []

    def put(self, row) -> None:
        self.rows.append({name: value for name, value in row.items() if name not in STAGES})


@dataclass(frozen=True)
class SimulatedSite:
    """As `runtime.calibration.session.Site`, with `truth` for the plant's rig."""

    truth: Rig
    seed: int = 0

    def flown(
        self, name: str, rig: Rig, plan: FlightPlan, spacer_m: float = 0.0, clip_kg: float = 0.0
    ) -> RunLog:
        """The flight's log; one that was flown before is not flown again."""
        way = tuple(part.tobytes() for part in (plan.z_m, plan.x_m, plan.source_us))
        asked = way, plan.motors_off, spacer_m, clip_kg
        flight = self.truth.sha256, self.seed, rig.sha256, asked
        if flight not in _FLOWN:
            _FLOWN[flight] = self._flown(rig, plan, spacer_m, clip_kg)
        log = _FLOWN[flight]
        return RunLog({n: c.copy() for n, c in log.columns.items()}, dict(log.metadata))

    def _flown(self, rig: Rig, plan: FlightPlan, spacer_m: float, clip_kg: float) -> RunLog:
        truth = with_clip(self.truth, clip_kg)
        plant = GantryPlant(truth, seed=self.seed, spacer_m=spacer_m)
        world = SimulatedGantry(plant, truth=truth, seed=self.seed)
        rows = Rows()
        loop = Loop(rig, world, world, plan, None, rows, world)
        loop.run()
        assert not loop.failsafe_cause, loop.failsafe_cause
        return RunLog.from_rows(rows.rows, {"rig_toml": rig.text}).without_truth()
