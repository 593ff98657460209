"""Whether the range sensor shows the past: readings older than their stamps say.

In: each tick's measurement, and the commands before it. Out: evidence, and the estimate of a filter
that believes in late readings. A stamp cannot show that it lies, but the motion can. Two more
filters expect each reading to show what the commands of some ticks before have done. If one of
them foresees the readings better than the loop's own filter, tick after tick, the readings are
late (Page 1954). A wake does not look like this: no filter foresees it, and all are surprised.
"""

import math
from collections import deque

import numpy as np

from runtime.loop.copies import replace
from runtime.loop.estimate import Estimate, Measurement, initial_estimate
from runtime.loop.estimator import Estimator
from runtime.loop.innovations import log_likelihood
from runtime.loop.pilot import PilotState
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig

LATE_TICKS = (3, 6)  # a tenth and a fifth of a second
_MOST_A_TICK = 1.5  # a stray counts as this much at most
_FORESEEN = 9.0  # an innovation's square over its variance; up to it a reading was foreseen
_AIRBORNE_M = 0.05  # nearer to it, the stop moves the sufferer, too
_REFUTED = 6.0  # log likelihood of the loop's own filter over an adopted one, to return to it

Acted = tuple[tuple[float, float], float | None]  # pulses [µs] of a tick, and its wake [N]


class Lateness:
    """The filters that believe in late readings, and the evidence for each."""

    def __init__(self, rig: Rig) -> None:
        self._estimator = Estimator(rig)
        self._acted: deque[Acted] = deque(maxlen=max(LATE_TICKS) + 1)
        self._rivals = {ticks: initial_estimate(0.0) for ticks in LATE_TICKS}
        self._evidence = dict.fromkeys(LATE_TICKS, 0.0)
        self._adopted: int | None = None
        self._own_estimate: Estimate | None = (
            None  # of the loop's own filter, while another is believed
        )
        self._against = 0.0  # evidence against the adopted one
        self._is_refuted = False
        self._waiting: tuple[PilotState, PilotState, Measurement] | None = None

    @property
    def evidence(self) -> float:
        """Log likelihood of the best of them over the loop's own filter since it was last less."""
        return max(self._evidence.values())

    def step(self, before: PilotState, now: PilotState, measured: Measurement) -> PilotState:
        """One tick: the state by the loop's own filter, or by the adopted one.

        Until one is adopted the command does not wait for the filters: `catch_up` runs them later.
        """
        self._waiting = None if self._adopted is not None else (before, now, measured)
        if self._adopted is None:
            return now
        self._follow(before, now, measured)
        own_estimate = self._followed_own(before, now, measured)
        if self._is_refuted:
            self._adopted = None
            return replace(now, estimate=own_estimate)
        return replace(now, estimate=self._present(now.estimate))

    def catch_up(self) -> None:
        """Take in the tick's reading for the next tick; the command is already on its way."""
        if self._waiting is not None:
            self._follow(*self._waiting)

    def _follow(self, before: PilotState, now: PilotState, measured: Measurement) -> None:
        self._acted.append(((before.before_last_us, before.last_us), now.wake_n))
        for ticks, rival in self._rivals.items():
            pulses, wake_n = self._acted[max(len(self._acted) - 1 - ticks, 0)]
            after = self._estimator.step(rival, measured, pulses, wake_n)
            self._rivals[ticks] = after
            if self._adopted is None:
                more = _for_the_rival(now.estimate, after)
                self._evidence[ticks] = max(self._evidence[ticks] + more, 0.0)

    def _followed_own(self, before: PilotState, now: PilotState, measured: Measurement) -> Estimate:
        """The loop's own filter goes on beside the adopted one, and may prove to be the better."""
        pulses = (before.before_last_us, before.last_us)
        last = self._own_estimate
        own_estimate = (
            now.estimate
            if last is None
            else self._estimator.step(last, measured, pulses, now.wake_n)
        )
        rival, more = self._rivals[self._adopted or LATE_TICKS[0]], 0.0
        if math.isfinite(own_estimate.innovation_m + rival.innovation_m):
            more = log_likelihood(own_estimate) - log_likelihood(rival)
            more = min(max(more, -_MOST_A_TICK), _MOST_A_TICK)
        self._own_estimate, self._against = own_estimate, max(self._against + more, 0.0)
        self._is_refuted = self._against > _REFUTED
        return own_estimate

    def adopt(self) -> None:
        """Believe the likeliest filter from now on, unless the loop's own proves better."""
        if self._adopted is None and not self._is_refuted:
            self._adopted = max(self._evidence, key=self._evidence.__getitem__)

    def _present(self, now: Estimate) -> Estimate:
        """The present by the adopted filter: its past state, and the commands since then."""
        ticks = self._adopted or 0
        then = self._rivals[ticks]
        since = list(self._acted)[-ticks:]
        passed_s = 1.0 / LOOP_RATE_HZ
        for pulses, wake_n in since:
            then = self._estimator.ahead(then, then.t_s + passed_s, pulses, wake_n)
        if then.z_m < 0.0:  # no filter knows of the stop
            then = replace(then, height=np.array([0.0, max(then.vz_mps, 0.0), 0.0]))
        return replace(then, t_s=now.t_s, lateral=now.lateral, lateral_cov=now.lateral_cov)


def _for_the_rival(own_estimate: Estimate, rival: Estimate) -> float:
    """One reading's log likelihood of the rival over the loop's own filter; 0 without a reading.

    What surprises both, as a push does, does not count for the rival. Noise favours neither: the
    larger it is, the farther two sums of it stray apart.
    """
    is_judged = own_estimate.z_m > _AIRBORNE_M and math.isfinite(
        own_estimate.innovation_m + rival.innovation_m
    )
    if not is_judged or own_estimate.sudden_ticks or own_estimate.noise_scale > 1.0:
        return 0.0
    foresees = rival.innovation_m**2 < _FORESEEN * rival.innovation_var_m2
    more = log_likelihood(rival) - log_likelihood(own_estimate)
    return min(max(more, -_MOST_A_TICK), _MOST_A_TICK if foresees else 0.0)
