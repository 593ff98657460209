"""Turbulence: a coloured fluctuation that scales with the force of the wake."""

import math

import numpy as np


class OrnsteinUhlenbeck:
    """A unit-variance Ornstein–Uhlenbeck process in exact steps of `dt_s`."""

    def __init__(self, time_s: float, dt_s: float, rng: "np.random.Generator") -> None:
        self._keep = math.exp(-dt_s / time_s)
        self._kick = math.sqrt(1.0 - self._keep**2)
        self._rng = rng
        self.value = float(rng.standard_normal())

    def step(self) -> float:
        """The process one step later."""
        self.value = self._keep * self.value + self._kick * float(self._rng.standard_normal())
        return self.value
