"""A rig on which a test lets something fail, in simulated time."""

from dataclasses import replace

from runtime.loop.loop import Loop
from runtime.reference import FlightPlan
from runtime.simulated import SimulatedGantry
from wakedeploy.core.rig import Rig
from wakedeploy.physics.gantry import GantryPlant


class Bench(SimulatedGantry):
    """A simulated gantry that keeps what it was commanded and what its board put out."""

    muted = False  # whether what is sent gets lost

    def __init__(self, rig: Rig, **made) -> None:
        plant = GantryPlant(rig, seed=3, **made)
        super().__init__(plant, truth=rig, seed=3)
        self.commands, self.applied_us, self.limits = [], [], None
        self.changes = {}

    def arm(self, limits):
        self.limits = limits
        super().arm(limits)
        return self.answer.status

    def send(self, message):
        self.commands.append((message.source_us, message.sufferer_us))
        self.applied_us.append(self.plant.sufferer_applied_us)
        return super().send(message)

    def _transmit(self, data, message):
        if not self.muted:
            super()._transmit(data, message)

    @property
    def answer(self):
        answer = super().answer
        return replace(answer, status=replace(answer.status, **self.changes))


class Rows:
    """Rows, and something to do after one of them."""

    def __init__(self, at: int, act) -> None:
        self.rows, self.error, self._at, self._act = [], None, at, act

    def put(self, row):
        self.rows.append(row)
        if len(self.rows) == self._at:
            self._act()


def ended_by(rig: Rig, plan: FlightPlan, at: int, fault, **plant):
    """A run at whose tick `at` a fault comes, with `plant` for the plant: loop, bench and rows."""
    bench = Bench(rig, **plant)
    rows = Rows(at, lambda: fault(loop, bench, rows))
    loop = Loop(rig, bench, bench, plan, None, rows, bench)
    loop.run()
    return loop, bench, rows.rows
