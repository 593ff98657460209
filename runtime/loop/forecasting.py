"""What becomes of a tick's prediction: it is asked for, checked, doubted, and gated.

In: the predictions' source, and what the pilot estimates. Out: a force to feed forward, or why not.
"""

from dataclasses import dataclass

from runtime.loop import safety
from runtime.loop.copies import replace
from runtime.loop.doubt import Doubter
from runtime.loop.pilot import Pilot, PilotState
from runtime.loop.prediction_worker import Predictions
from runtime.loop.safety import Gate
from runtime.reference import Reference
from wakedeploy.core.rig import Rig
from wakedeploy.physics.rail import GRAVITY_MPS2


@dataclass(frozen=True, slots=True)
class Prediction:
    """What became of one tick's prediction; `force_n` is None where it must not be used."""

    logged_n: float | None = None
    force_n: float | None = None
    late: bool = False
    bad_prediction: bool = False
    bad_observation: bool = False
    doubted: bool = False


class Forecasting:
    """A flight's predictions; without a `worker` there are none."""

    def __init__(self, rig: Rig, pilot: Pilot, worker: Predictions | None) -> None:
        self._pilot, self._worker = pilot, worker
        weight_n = rig.sufferer.mass_kg * GRAVITY_MPS2
        self._most_n = safety.MOST_FEEDFORWARD * weight_n
        self._doubter = Doubter(worker.lead_s, weight_n) if worker is not None else None
        self._gate = Gate()

    def ask(self, state: PilotState, aim: Reference, t_s: float, deadline_s: float) -> Prediction:
        """Ask the model and wait until the deadline; an unusable result resets its memory."""
        if self._worker is None or self._doubter is None:
            return Prediction()
        asked = self._asked(self._worker, state, aim, deadline_s)
        if asked.logged_n is not None:
            self._doubter.predicted(t_s, asked.logged_n)
        return replace(asked, doubted=self._doubter.step(t_s, state.unexplained_n))

    def _asked(
        self, worker: Predictions, state: PilotState, aim: Reference, deadline_s: float
    ) -> Prediction:
        observed = self._pilot.observe(state, aim)
        if safety.far_outside(observed, worker.low, worker.high):
            worker.reset()
            return Prediction(bad_observation=True)
        result = worker.step(observed, deadline_s)
        if result is None:
            return Prediction(late=True)
        is_bounded = abs(result.force_n) <= self._most_n  # NaN is not
        if not (is_bounded and worker.is_possible(result.force_n)):
            worker.reset()
            return Prediction(bad_prediction=True)
        return Prediction(result.force_n, result.force_n if result.ready else None)

    def fed_forward_n(self, usable_n: float | None) -> float | None:
        """The thrust [N] to add, through the gate; None while nothing passes.

        Without a share in the command the estimator must expect any wake, hence None.
        """
        self._gate = safety.gate(self._gate, usable_n)
        return -self._gate.share * self._gate.force_n if self._gate.share else None
