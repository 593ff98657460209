"""Whether predictions explain the force that the sufferer feels better than no prediction would.

In: each tick's prediction, and the force that the estimator finds without it. Out: doubt. A model
may be wrong about this rig, this air, or the sign of its force, and its own numbers do not show it.
"""

import math
from collections import deque
from dataclasses import dataclass

WINDOW_S = 0.5  # the two errors are averaged over this
MOST_LEFT = 0.7  # of the force's mean square: a prediction that explains less is worth nothing
# The error of an estimated force, and of a thrust that is a few per cent off its curve.
FORCE_FLOOR_N = 0.3
FLOOR_SHARE = 0.07  # of the weight, for sufferers of another size


@dataclass(frozen=True, slots=True)
class Doubt:
    """Mean squares [N²] of what a prediction leaves over and of the force itself."""

    left_n2: float = 0.0
    whole_n2: float = 0.0

    def exceeds(self, floor_n: float) -> bool:
        """Whether the prediction leaves over most of the force, and more than a floor."""
        return self.left_n2 > MOST_LEFT * self.whole_n2 + floor_n**2


def weighed(before: Doubt, force_n: float, predicted_n: float, dt_s: float) -> Doubt:
    """One tick: `force_n` is what acts now [N], `predicted_n` what was predicted for now."""
    if not (math.isfinite(force_n) and math.isfinite(predicted_n)):
        return before
    share = 1.0 - math.exp(-dt_s / WINDOW_S)
    left_n2 = before.left_n2 + share * ((force_n - predicted_n) ** 2 - before.left_n2)
    whole_n2 = before.whole_n2 + share * (force_n**2 - before.whole_n2)
    return Doubt(left_n2, whole_n2)


class Doubter:
    """Holds predictions until the time that they are for, and the doubt so far."""

    def __init__(self, lead_s: float, weight_n: float) -> None:
        self._lead_s = lead_s
        self._floor_n = min(FORCE_FLOOR_N, FLOOR_SHARE * weight_n)
        self._waiting: deque[tuple[float, float]] = deque()  # (for when [s], force [N])
        self._acting_n: float | None = None
        self._t_s = 0.0
        self.doubt = Doubt()

    def predicted(self, t_s: float, force_n: float) -> None:
        """Take in a prediction made at `t_s`, used or not."""
        self._waiting.append((t_s + self._lead_s, force_n))

    def step(self, t_s: float, force_n: float) -> bool:
        """Whether to doubt, given the force [N] that the estimator finds at `t_s`."""
        dt_s, self._t_s = min(max(t_s - self._t_s, 0.0), WINDOW_S), t_s
        while self._waiting and self._waiting[0][0] <= t_s:
            self._acting_n = self._waiting.popleft()[1]
        if self._acting_n is not None:
            self.doubt = weighed(self.doubt, force_n, self._acting_n, dt_s)
        return self.doubt.exceeds(self._floor_n)
