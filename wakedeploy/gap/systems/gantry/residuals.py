"""What a fitted model leaves unexplained along a flight, and the coordinates it may depend on.

In: a model and a fit. Out: residual series of four kinds, all measured minus simulated.

*Force*: the balance of momentum over a quarter of a second: mass times gain of speed, less every
force of the model, including the commands' thrust [N].
*Control effort*: the same balance over a second. Feedback holds the height, so the sufferer hardly
gains speed in a second, and the command answers the force that the model lacks. The balance is then
the thrust beyond what the model needs for this motion, with the sign of the missing force [N]. The
mean command would not do: it also answers the wake and the reference, which the model knows.
*Height 0.25 s ahead*: open-loop replay from the filtered state [m].
*Innovation*: each reading less what the filter predicts of it, over its standard deviation.
"""

import numpy as np

from wakedeploy.gap.evidence.fits import Fit
from wakedeploy.gap.search.places import INNOVATION, Residuals
from wakedeploy.gap.systems.gantry.flight import DT_S, GRID_HZ, Flight, FloatArray
from wakedeploy.gap.systems.gantry.likelihood import GantryModel

CHANNELS = {"force": "N", "control effort": "N", "height 0.25 s ahead": "m", INNOVATION: "sd"}
AHEAD_S = 0.25
_WINDOW_S = {"force": 0.25, "control effort": 1.0}
_EVERY_S = 0.125
_NEXT_S = 0.1  # longer after the last reading, height and speed are hardly known
_JUST_BEFORE_S = 0.001

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


def residuals(model: GantryModel, fitted: Fit, channel: str, episode: int) -> Residuals:
    """A channel of `CHANNELS` along one flight, in its unit; KeyError for another channel.

    Fed-back coordinates are those known before the channel's window began or the reading was taken.
    Exogenous ones, which no disturbance can change, are those at the window's middle.
    """
    if channel not in CHANNELS:
        raise KeyError(f"{channel!r} is none of {', '.join(CHANNELS)}")
    if channel == INNOVATION:
        at_s, value = _innovations(model, fitted, episode)
        before_s = at_s - _JUST_BEFORE_S
    elif channel in _WINDOW_S:
        at_s, value = _balance(model, fitted, episode, _WINDOW_S[channel])
        before_s = at_s - 0.5 * _WINDOW_S[channel]
    else:
        before_s, value = _ahead(model, fitted, episode)
        at_s = before_s + 0.5 * AHEAD_S
    coordinates = _exogenous(model, episode, at_s)
    coordinates |= _fed_back(model, fitted, episode, before_s)
    return Residuals(channel, at_s, value, coordinates)


def _innovations(model: GantryModel, fitted: Fit, episode: int) -> tuple[FloatArray, FloatArray]:
    """The times of the readings, and their whitened innovations."""
    flight = model.flights[episode]
    sample_s = flight.sample_s[flight.counted]
    white = model.score(fitted.hypothesis, fitted.theta, episode).white
    return sample_s, white[: len(sample_s)]


def _ahead(model: GantryModel, fitted: Fit, episode: int) -> tuple[FloatArray, FloatArray]:
    """The times at which forecasts began, and the reading less the forecast [m]."""
    ahead = model.forecasts(fitted, episode, (AHEAD_S,))
    error = ahead.measured_m[0] - ahead.forecast_m[0]
    known = np.isfinite(error)
    limit = 5.0 * float(np.median(np.abs(error[known]))) if known.any() else 0.0
    # readings that stray say nothing
    return ahead.at_s[known], np.clip(error[known], -limit, limit)


def _balance(
    model: GantryModel, fitted: Fit, episode: int, window_s: float
) -> tuple[FloatArray, FloatArray]:
    """Middles of windows [s], and the mean force [N] that the model lacks over each."""
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
        return np.zeros(0), np.zeros(0)
    return flight.grid_s[np.concatenate(middles)] + 0.5 * DT_S, np.concatenate(missing)


def _exogenous(model: GantryModel, episode: int, t_s: FloatArray) -> dict[str, FloatArray]:
    """What is known beforehand, at these times (m,)."""
    flight = model.flights[episode]
    at = _steps(flight, t_s)
    source = flight.source.at(t_s)
    moving = np.sign(np.where(np.abs(flight.vx_mps[at]) > 0.02, flight.vx_mps[at], 0.0))
    references = flight.references
    height = np.full(len(at), np.nan)
    if references is not None and (known := np.isfinite(references[0])).any():
        height = np.interp(t_s, flight.sample_s[known], references[0][known])
    return {
        "source command": source,
        "source command slope": (source - flight.source.at(t_s - 0.2)) / 0.2,
        "carriage position": flight.x_m[at],
        "carriage speed": flight.vx_mps[at],
        "carriage direction": moving,
        "height reference": height,
        "time in flight": t_s - flight.take_off_s,
    }


def _fed_back(
    model: GantryModel, fitted: Fit, episode: int, t_s: FloatArray
) -> dict[str, FloatArray]:
    """What the sufferer does at these times (m,), as known then; NaN where unknown.

    Height and speed are the filter's forecast from the last reading. The smoothed motion would not
    do: it has seen what came after, and so follows the disturbance that a residual shows.
    """
    flight = model.flights[episode]
    sample_s = flight.sample_s[flight.counted]
    steps = max(round(flight.spacing_s * GRID_HZ), 2)  # to the next reading
    ahead = model.forecasts(fitted, episode, (DT_S, steps * DT_S))
    near_m, next_m = ahead.forecast_m
    last = np.searchsorted(sample_s, t_s + 1e-9, side="right") - 1
    age_s = t_s - sample_s[last]
    speed_mps = (next_m - near_m)[last] / ((steps - 1) * DT_S)
    speed_mps[(last < 0) | (age_s > _NEXT_S)] = np.nan
    return {
        "height": near_m[last] + speed_mps * (t_s - ahead.then_s[0][last]),
        "vertical speed": speed_mps,
        "sufferer command": flight.sufferer.at(t_s),
        "wake force": model.forces(fitted, episode).wake_n[_steps(flight, t_s)],
    }


def _steps(flight: Flight, t_s: FloatArray) -> np.typing.NDArray[np.int64]:
    """The grid's steps in which these times lie."""
    at = ((t_s - flight.grid_s[0]) * GRID_HZ).astype(np.int64)
    return np.asarray(np.clip(at, 0, len(flight.grid_s) - 1))
