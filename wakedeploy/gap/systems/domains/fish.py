"""The flag behind the foil: a baseline that answers at once, and what it may lack.

In: recordings of `wakedeploy.domains.fish` at 30 Hz. The flag's tip is a sum of the foil's angle
and the flow, with coloured noise; pieces of ten seconds are episodes. The flag's front is no input
here: it is a part of what answers.
"""

import copy
import functools
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import coherence, csd, lfilter

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.fish import RATE_HZ, import_set
from wakedeploy.gap.evidence.fits import FloatArray, Free
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.progress import Progress, StepsDone, uncounted
from wakedeploy.gap.search.comparison import Record
from wakedeploy.gap.systems.domains.domain import GapDomain
from wakedeploy.gap.systems.likelihood.response import ResponseModel, Values, required

PIECE_S = 10.0
HISTORY_S = 1.0  # of inputs before a piece, so that delays look back at what was measured

EFFECTS = {
    "transport-delay": (
        Free(
            "transport-delay.delay_s", "s", 0.0, 0.3, 0.0, 0.9, 1e-3, (0.08, 0.16, 0.24, 0.32, 0.4)
        ),
    ),
    "lag": (Free("lag.tau_s", "s", 0.0, 0.3, 0.0, 3.0, 1e-3, (0.05, 0.3)),),
    "flow-delay": (Free("flow-delay.delay_s", "s", 0.0, 0.3, 0.0, 0.9, 1e-3, (0.1, 0.33)),),
    "flow-gain": (Free("flow-gain.share_per_mps", "s/m", 0.0, 3.0, -20.0, 20.0, 1e-2, (1.0,)),),
    "resonance": (
        Free("resonance.share", "1", 0.0, 1.0, -3.0, 3.0, 1e-2, (0.5, -0.5)),
        Free("resonance.frequency_hz", "Hz", 3.3, 1.0, 1.0, 8.0, 1e-2, (3.3,)),
    ),
    "saturation": (Free("saturation.per_rad2", "1/rad²", 0.0, 3.0, -10.0, 10.0, 1e-2, (-0.5,)),),
    "phase-lead": (Free("phase-lead.lead_s", "s", 0.0, 0.1, -1.0, 1.0, 1e-3, (0.02, -0.02)),),
}
_DAMPING = 0.15  # of the resonance, relative to critical


class FishModel(ResponseModel):
    """The flag tip's displacement [mm]."""

    name = "fish"
    channels = (("flag tip", "mm"),)
    noise_start = ((5.0, 0.1, 0.3),)
    effects = EFFECTS

    def __init__(self, observation: FloatArray, tip_m: FloatArray) -> None:
        self._angle, self._flow = observation[:, :2].T.astype(float)
        self._rate = np.gradient(self._angle) * RATE_HZ
        self._flow = self._flow - self._flow.mean()
        tip_mm = (tip_m - tip_m.mean()).astype(float) * 1e3
        self._tip_mm = tip_mm
        length, first = round(PIECE_S * RATE_HZ), round(HISTORY_S * RATE_HZ)
        self._starts = list(range(first, len(tip_mm) - length + 1, length))
        self.records = [
            Record(f"piece-{k + 1}", np.arange(length) / RATE_HZ, tip_mm[None, s : s + length])
            for k, s in enumerate(self._starts)
        ]

    def first(self, pieces: int) -> "FishModel":
        """The model over the first pieces alone."""
        part = copy.copy(self)
        part.records = self.records[:pieces]
        return part

    def phase_delay(self, *, near_s: float = 1.0 / 3.0) -> dict[str, list[float]]:
        """Phase delay [s] from foil to tip over the frequency [Hz], by Welch's cross-spectrum.

        Of the delays that a phase allows, the one nearest to `near_s`; where the coherence is 0.8.
        """
        spectra = {"fs": RATE_HZ, "nperseg": 512}
        frequency, cross = csd(self._angle, self._tip_mm, **spectra)
        _, coherent = coherence(self._angle, self._tip_mm, **spectra)
        kept = (coherent > 0.8) & (frequency > 0.2)
        turns = -np.angle(cross[kept]) / (2.0 * np.pi)
        turns += np.round(near_s * frequency[kept] - turns)
        delay_s = turns / frequency[kept]
        return {"frequency_hz": frequency[kept].tolist(), "delay_s": delay_s.tolist()}

    def nuisances(self) -> tuple[Free, ...]:
        """Gains of the two inputs, in millimetres per unit."""
        return (
            Free("gain.angle", "mm/rad", 0.0, 100.0, -1e3, 1e3, 0.1),
            Free("gain.flow", "mm s/m", 0.0, 100.0, -1e3, 1e3, 0.1),
        )

    def response(self, values: Values, episode: int) -> FloatArray:
        """The tip (1, n) [mm] after delay, lag, resonance and the rest."""
        delay_s = values.get("transport-delay.delay_s", 0.0)
        bend = values.get("saturation.per_rad2", 0.0)
        angle = self._angle * (1.0 + bend * self._angle**2)
        rate = self._rate * (1.0 + 3.0 * bend * self._angle**2)
        foil = values["gain.angle"] * (angle + values.get("phase-lead.lead_s", 0.0) * rate)
        foil = foil * (1.0 + values.get("flow-gain.share_per_mps", 0.0) * self._flow)
        foil = _lagged(foil, values.get("lag.tau_s", 0.0))
        foil = _resonant(foil, values)
        tip = self._cut(foil, episode, delay_s)
        flow_s = values.get("flow-delay.delay_s", 0.0)
        tip += values["gain.flow"] * self._cut(self._flow, episode, flow_s)
        return tip[None]

    def coordinates(self, episode: int) -> dict[str, tuple[str, FloatArray]]:
        """Foil angle now and a third of a second ago, its rate, and the flow."""
        return {
            "foil angle": ("rad", self._cut(self._angle, episode)),
            "foil angle 1/3 s ago": ("rad", self._cut(self._angle, episode, 1.0 / 3.0)),
            "foil rate": ("rad/s", self._cut(self._rate, episode)),
            "flow": ("m/s", self._cut(self._flow, episode)),
        }

    def _cut(self, series: FloatArray, episode: int, delay_s: float = 0.0) -> FloatArray:
        """An episode's part of a series, delayed; between samples the straight line."""
        start = self._starts[episode]
        at = start + np.arange(len(self.records[episode].time_s)) - delay_s * RATE_HZ
        return np.asarray(np.interp(at, np.arange(len(series)), series))


def open_model(path: Path | None) -> FishModel:
    """The model over the first recording below `path`, its splits joined again."""
    imported = import_set(required(path, "fish"))
    first = imported.episodes[0].name.rsplit("-", 1)[0]
    parts = [e for e in imported.episodes if e.name.rsplit("-", 1)[0] == first]
    model = FishModel(
        np.concatenate([p.observation for p in parts]),
        np.concatenate([p.force[:, 0] for p in parts]),
    )
    if model.episodes < 4:
        raise UnusableInput(f"{path}: {first} is shorter than 41 s; give a longer recording.")
    return model


def further(model: FishModel, progress: Progress) -> dict[str, Any]:
    """The likelihood over the delay, in steps of a sixtieth of a second."""
    delays_s = np.arange(0, 37) / 60.0
    stage = "refitting at each delay"
    progress(stage)
    profile = delay_profile(model, delays_s, functools.partial(progress, stage))
    return {
        "delay_profile": {"delay_s": delays_s.tolist(), "nats": (profile - profile.max()).tolist()},
        "phase_delay": model.phase_delay(),
    }


def delay_profile(
    model: FishModel, delays_s: FloatArray, steps: StepsDone = uncounted
) -> FloatArray:
    """Largest log likelihood [nats] at each delay, all other parameters refitted, (n,)."""
    pinned = _Pinned(model)
    everything = range(model.episodes)
    profile, theta = [], None
    for delay_s in delays_s:
        pinned.delay_s = float(delay_s)
        fitted = fit(pinned, (), everything, theta)
        theta = fitted.theta
        profile.append(fitted.log_likelihood)
        steps(len(profile), len(delays_s))
    return np.array(profile)


class _Pinned(FishModel):
    """The model with the delay held at one value."""

    delay_s = 0.0

    def __init__(self, model: FishModel) -> None:
        self.__dict__.update(vars(model))

    def response(self, values: Values, episode: int) -> FloatArray:
        return super().response({**values, "transport-delay.delay_s": self.delay_s}, episode)


def _lagged(series: FloatArray, tau_s: float) -> FloatArray:
    """A first-order lag, exact for an input held over the step."""
    if tau_s <= 1e-6:
        return series
    kept = float(np.exp(-1.0 / (tau_s * RATE_HZ)))
    return np.asarray(lfilter([1.0 - kept], [1.0, -kept], series))


def _resonant(series: FloatArray, values: Values) -> FloatArray:
    """The input and a share of what a lightly damped oscillator makes of it."""
    share = values.get("resonance.share", 0.0)
    if share == 0.0:
        return series
    turn = 2.0 * np.pi * values["resonance.frequency_hz"] / RATE_HZ
    radius = float(np.exp(-_DAMPING * turn))
    poles = [1.0, -2.0 * radius * np.cos(turn), radius**2]
    return np.asarray(series + share * lfilter([0.0, sum(poles)], poles, series))


GAP_DOMAIN = GapDomain(open_model, further)
