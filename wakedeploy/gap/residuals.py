"""What a fitted model leaves unexplained along a flight, and the coordinates it may depend on.

In: a model and a fit. Out: residual series of four kinds, all measured minus simulated.

*Force*: the balance of momentum over a quarter of a second, that is mass times gain of speed less
every force of the model, the commands' thrust included [N].
*Control effort*: the same balance over a second. Feedback holds the height, so over a second hardly
any speed is gained, and the command answers a force that the model lacks: the balance is then the
thrust that the commands give beyond what the model needs for this motion, with the opposite sign,
that of the missing force [N]. The mean command alone would not do: it also answers the wake and the
reference, which the model knows.
*Height 0.25 s ahead*: open-loop replay from the filtered state [m].
*Innovation*: each reading less what the filter predicts of it, over its standard deviation.
"""

from dataclasses import dataclass

import numpy as np

from wakedeploy.gap.flight import DT_S, GRID_HZ, FloatArray
from wakedeploy.gap.gantry import GantryModel
from wakedeploy.gap.inference import Fit
from wakedeploy.physics.rail import GRAVITY_MPS2

CHANNELS = {"force": "N", "control effort": "N", "height 0.25 s ahead": "m", "innovation": "sd"}
AHEAD_S = 0.25
_WINDOW_S = {"force": 0.25, "control effort": 1.0}
_EVERY_S = 0.125
_NEXT_S = 0.1  # a reading that comes later than this was hardly predicted

# name: unit, and whether it is known whatever the sufferer does
COORDINATES = {
    "source command": ("us", True),
    "source command slope": ("us/s", True),
    "carriage position": ("m", True),
    "carriage speed": ("m/s", True),
    "carriage direction": ("", True),
    "height reference": ("m", True),
    "time in flight": ("s", True),
    "height": ("m", False),
    "vertical speed": ("m/s", False),
    "sufferer command": ("us", False),
    "wake force": ("N", False),
}


@dataclass(frozen=True, eq=False)
class Residuals:
    """One flight's residuals of one channel at some times (n,), and the coordinates there.

    The coordinates of innovations are those known before the reading. The other channels look at
    the middle of their window, where what the sufferer does (height, speed, its command) has
    already answered a part of the disturbance within it.
    """

    channel: str
    at_s: FloatArray
    value: FloatArray
    coordinates: dict[str, FloatArray]


def residuals(model: GantryModel, fitted: Fit, channel: str, episode: int) -> Residuals:
    """A channel of `CHANNELS` along one flight, in its unit; KeyError for another channel."""
    if channel not in CHANNELS:
        raise KeyError(f"{channel!r} is none of {', '.join(CHANNELS)}")
    if channel == "innovation":
        return _innovations(model, fitted, episode)
    if channel in _WINDOW_S:
        at, value = _balance(model, fitted, episode, _WINDOW_S[channel])
        start_s = model.flights[episode].grid_s[at] + 0.5 * DT_S
        return Residuals(channel, start_s, value, _coordinates(model, fitted, episode, at))
    ahead = model.forecasts(fitted, episode, (AHEAD_S,))
    error = ahead.measured_m[0] - ahead.forecast_m[0]
    known = np.isfinite(error)
    grid_s = model.flights[episode].grid_s
    # The forecast is about the time between its start and its end.
    at = ((ahead.at_s[known] + 0.5 * AHEAD_S - grid_s[0]) * GRID_HZ).astype(np.int64)
    at = np.minimum(at, len(grid_s) - 1)
    limit = 5.0 * float(np.median(np.abs(error[known]))) if known.any() else 0.0
    clipped = np.clip(error[known], -limit, limit)  # readings that stray say nothing
    return Residuals(channel, grid_s[at], clipped, _coordinates(model, fitted, episode, at))


def _innovations(model: GantryModel, fitted: Fit, episode: int) -> Residuals:
    """Whitened, with the height and speed that the filter forecasts from the reading before.

    The smoothed motion would not do as a coordinate: it has seen the reading itself.
    """
    flight = model.flights[episode]
    sample_s = flight.sample_s[flight.counted]
    white = model.score(fitted.hypothesis, fitted.theta, episode).white[: len(sample_s)]
    steps = max(round(flight.spacing_s * GRID_HZ), 2)  # to the next reading
    ahead = model.forecasts(fitted, episode, (DT_S, steps * DT_S))
    follows = np.flatnonzero(np.diff(sample_s) < _NEXT_S)  # by the reading that it follows
    at = ((sample_s[follows] - flight.grid_s[0]) * GRID_HZ).astype(np.int64)
    near_m, height_m = ahead.forecast_m[:, follows]
    coordinates = _coordinates(model, fitted, episode, at) | {
        "height": height_m,
        "vertical speed": (height_m - near_m) / ((steps - 1) * DT_S),
    }
    return Residuals("innovation", sample_s[follows + 1], white[follows + 1], coordinates)


def _balance(
    model: GantryModel, fitted: Fit, episode: int, window_s: float
) -> tuple[np.typing.NDArray[np.int64], FloatArray]:
    """Middles of windows, and the mean force [N] that the model lacks over each."""
    flight, forces = model.flights[episode], model.forces(fitted, episode)
    mass_kg = model.rig.sufferer.mass_kg
    half, every = round(0.5 * window_s * GRID_HZ), round(_EVERY_S * GRID_HZ)
    modelled = np.concatenate([[0.0], np.cumsum(forces.acceleration[0])]) * DT_S
    middles, missing = [], []
    for start, stop in zip(flight.start, flight.stop, strict=True):
        middle = np.arange(start + half + every, stop - half - every, every)
        gained = flight.nominal[1, middle + half] - flight.nominal[1, middle - half]
        expected = modelled[middle + half] - modelled[middle - half]
        middles.append(middle)
        missing.append(mass_kg * (gained - expected) / window_s)
    if not middles:
        return np.zeros(0, np.int64), np.zeros(0)
    return np.concatenate(middles), np.concatenate(missing)


def _coordinates(
    model: GantryModel, fitted: Fit, episode: int, at: np.typing.NDArray[np.int64]
) -> dict[str, FloatArray]:
    flight, forces = model.flights[episode], model.forces(fitted, episode)
    t_s = flight.grid_s[at]
    source = flight.source.at(t_s)
    moving = np.sign(np.where(np.abs(flight.vx_mps[at]) > 0.02, flight.vx_mps[at], 0.0))
    references = flight.references
    height = np.full(len(at), np.nan)
    if references is not None:
        height = np.interp(t_s, flight.sample_s, np.nan_to_num(references[0]))
    return {
        "source command": source,
        "source command slope": (source - flight.source.at(t_s - 0.2)) / 0.2,
        "carriage position": flight.x_m[at],
        "carriage speed": flight.vx_mps[at],
        "carriage direction": moving,
        "height reference": height,
        "time in flight": t_s - flight.take_off_s,
        "height": flight.nominal[0, at],
        "vertical speed": flight.nominal[1, at],
        "sufferer command": flight.sufferer.at(t_s),
        "wake force": forces.wake_n[at],
    }


def mean_square(values: FloatArray) -> float:
    """Of finite values; 0 for none."""
    finite = values[np.isfinite(values)]
    return float((finite**2).mean()) if len(finite) else 0.0


def weight_n(model: GantryModel) -> float:
    """The sufferer's weight [N]."""
    return model.rig.sufferer.mass_kg * GRAVITY_MPS2
