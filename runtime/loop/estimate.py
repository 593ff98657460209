"""What one tick has measured, and what the filter makes of it: the records of `estimator`."""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

# A sensor with more noise or strays than this cannot be flown by. One stray in five is not many.
_TOO_MANY_STRAYS = 0.6
_TOO_NOISY, _MANY_STRAYS = 60.0, 0.45  # together: some 8 times the rig file's noise
_MERE_NOISE, _MERE_TICKS = 190.0, 20  # by itself: 14 times the noise, in most readings for long
_FEW_STRAYS = 0.1


@dataclass(frozen=True, slots=True)
class Measurement:
    """What one tick read: newest range sample (NaN: none), its age, its repeats; step count.

    The steps are as old as the newest answer; `steps_repeats` counts ticks without a new one.
    `same` counts samples in a row that say what the one before said, off the stop; `alike` counts
    them there, too. `acts_known`: the board has reported the last commands in time.
    """

    t_s: float
    range_m: float
    range_age_s: float
    range_repeats: int
    steps: int
    steps_repeats: int = 0
    same: int = 0
    alike: int = 0
    acts_known: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """Filter state after one tick; `height` is (z [m], vz [m/s], disturbance [N])."""

    t_s: float
    height: FloatArray  # (3,)
    height_cov: FloatArray  # (3, 3)
    lateral: FloatArray  # (2,)
    lateral_cov: FloatArray  # (2, 2)
    rotor_speed: float = 0.0  # of the sufferer, √N
    rejected: int = 0
    innovation_m: float = math.nan
    innovation_var_m2: float = math.nan
    off_m: float = math.inf  # the least error of the samples that were rejected in a row
    rejects: tuple[float, float, float] = (0.0, 0.0, 0.0)  # the same samples' first, last, path [m]
    jumped_m: float = 0.0  # `off_m`, when the next is taken in because too many were rejected
    surprise: float = 1.0  # mean square of innovations' differences over what noise gives
    last_innovation_m: float = math.nan
    stale_s: float = 0.0  # since a new sample says the same again and again
    noise_scale: float = 1.0  # of the sensor's variance over the rig file's
    stray_share: float = 0.0  # share of the latest samples that the rig file's noise cannot give
    rejected_s: float = 0.0  # how long every sample has been rejected
    pushed: tuple[float, float] = (0.0, 0.0)  # sums of innovations downwards and upwards, in sd
    side: int = 0  # innovations in a row to one side, with its sign
    wary_ticks: int = 0  # left after a stray; after a second one within them nothing adds up
    # The last readings, oldest first: when each was taken [s], what it said [m], its innovation.
    lately: tuple[tuple[float, float, float], ...] = ()
    sudden_ticks: int = 0  # since they are noisier than their mean has shown
    # The estimate without the last reported push, or without the first reading after a pause.
    unpushed: "Estimate | None" = None
    unpushed_more: float = 0.0  # log likelihood of `unpushed` over this one, since then
    unpushed_ticks: int = 0

    @property
    def is_noisy(self) -> bool:
        """Whether too little is left of the sensor's readings to fly by them."""
        most = _MANY_STRAYS if self.noise_scale > _TOO_NOISY else _TOO_MANY_STRAYS
        is_mere = self.noise_scale > _MERE_NOISE and self.sudden_ticks > _MERE_TICKS
        return self.stray_share > most or is_mere

    @property
    def is_calm(self) -> bool:
        """Whether the sensor says what the filter expects, as it nearly always does."""
        return self.noise_scale == 1.0 and not self.has_strays

    @property
    def has_strays(self) -> bool:
        """Whether more of the latest samples were strays than a sensor of this rig gives."""
        return self.stray_share >= _FEW_STRAYS

    @property
    def z_m(self) -> float:
        """Height [m]."""
        return float(self.height[0])

    @property
    def vz_mps(self) -> float:
        """Vertical speed [m/s]."""
        return float(self.height[1])

    @property
    def disturbance_n(self) -> float:
        """The force [N] that known thrust, weight, friction and forecast leave over."""
        return float(self.height[2])

    @property
    def x_m(self) -> float:
        """Lateral position [m]."""
        return float(self.lateral[0])

    @property
    def vx_mps(self) -> float:
        """Lateral speed [m/s]."""
        return float(self.lateral[1])


def initial_estimate(t_s: float) -> Estimate:
    """At rest on the stop, carriage homed."""
    return Estimate(
        t_s,
        np.zeros(3),
        np.diag([0.02**2, 0.01**2, 0.05**2]),
        np.zeros(2),
        np.diag([0.001**2, 0.01**2]),
    )
