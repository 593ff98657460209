"""A recording of a plant: what drives it, what is hidden at its input and sensor, and noise.

In: a plant, what is hidden, a kind of drive, a seed. Out: a `Recording` with the system's columns.
"""

import math
from collections import deque

import numpy as np
import numpy.typing as npt

from benchmarks.known_plants.controlled import Controlled
from benchmarks.known_plants.plants import Hidden, Plant
from wakedeploy.core.recording import Recording

FloatArray = npt.NDArray[np.float64]
SAMPLES = 1500
_FINE = 10  # steps within a sample
_COLOUR = 0.9  # of the sensor's coloured part, from one sample to the next


class Path:
    """What a command goes through before it acts, one fine step after another."""

    def __init__(self, hidden: Hidden, step_s: float, first: float) -> None:
        self._hidden, self._step_s = hidden, step_s
        late = round(hidden.get("delay", 0.0) / step_s)
        self._late = deque([first] * (late + 1), maxlen=late + 1)
        self._played = self._lagged = self._held = self._slewed = self._ringing = first
        self._ringing_per_s, self._since_s = 0.0, math.inf

    def __call__(self, u: float) -> float:
        """What acts now of what is commanded now."""
        self._late.append(u)
        u, h = self._late[0], self._hidden
        if "hold_s" in h:
            self._since_s += self._step_s
            if self._since_s >= h["hold_s"] - 0.5 * self._step_s:
                self._held, self._since_s = u, 0.0
            u = self._held
        if "grain" in h:
            u = h["grain"] * round(u / h["grain"])
        if "play" in h:
            half = 0.5 * h["play"]
            self._played = min(max(self._played, u - half), u + half)
            u = self._played
        if "band" in h:
            u = math.copysign(max(abs(u) - h["band"], 0.0), u)
        if "most" in h:
            u = min(max(u, -h["most"]), h["most"])
        if "uneven" in h:
            u += h["uneven"] * abs(u)
        if "slew_per_s" in h:
            most = h["slew_per_s"] * self._step_s
            self._slewed += min(max(u - self._slewed, -most), most)
            u = self._slewed
        if "lag" in h:
            self._lagged += (u - self._lagged) * min(self._step_s / h["lag"], 1.0)
            u = self._lagged
        if "rings_radps" in h:
            w = h["rings_radps"]
            pull = w * (w * (u - self._ringing) - 2.0 * h["damping"] * self._ringing_per_s)
            self._ringing_per_s += pull * self._step_s
            self._ringing += self._ringing_per_s * self._step_s
            u = self._ringing
        return u + h.get("bias", 0.0)


def recorded(plant: Plant, hidden: Hidden, drive: str, seed: int, coloured: bool) -> Recording:
    """A recording of `SAMPLES` samples; a plant without a controller is driven in steps."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(SAMPLES) / plant.system.rate_hz
    wanted = _wanted(plant, drive, time_s, rng)
    pushes = plant.pushed * rng.standard_normal((SAMPLES, len(plant.pushed_at)))
    noise = np.array([sd * _noise(rng, coloured) for _, sd in plant.shown])
    logged, shown = _flown(plant, hidden, wanted, pushes, noise, is_closed=drive == "closed")
    names = [o.name for o in plant.system.outputs]
    columns = {plant.system.inputs[0].name: logged, **dict(zip(names, shown, strict=True))}
    return Recording(f"{drive} {seed}", time_s, columns)


def _flown(
    plant: Plant,
    hidden: Hidden,
    wanted: FloatArray,
    pushes: FloatArray,
    noise: FloatArray,
    *,
    is_closed: bool,
) -> tuple[FloatArray, FloatArray]:
    """The logged input (n,) and what the sensors show (m, n)."""
    rate, x = plant.system.rate_hz, [*plant.start, *([0.0] if "bristle" in hidden else [])]
    step_s = 1.0 / rate / _FINE
    path = Path(hidden, step_s, 0.0 if is_closed else plant.mean)
    places = [i for i, _ in plant.shown]
    sensed, slow = [x[i] for i in places], hidden.get("sensor lag", step_s)
    logged, shown = np.empty(len(wanted)), np.empty(noise.shape)
    for k in range(len(wanted)):
        shown[:, k] = _read(np.array(sensed), k / rate, hidden) + noise[:, k]
        low, high = hidden.get("blind below", -math.inf), hidden.get("clip", math.inf)
        shown[:, k] = np.clip(shown[:, k], low, high)
        u = float(wanted[k])
        if is_closed and plant.follows is not None:
            speed = (shown[0, k] - shown[0, max(k - 1, 0)]) * rate
            u = float(plant.follows[0] * (u - shown[0, k]) - plant.follows[1] * speed)
        logged[k] = u
        for _ in range(_FINE):
            x = _stepped(plant, x, path(u), hidden, pushes[k], step_s)
            sensed = [s + (x[i] - s) * min(step_s / slow, 1.0)
                      for s, i in zip(sensed, places, strict=True)]  # fmt: skip
    return logged, shown


def _read(values: FloatArray, time_s: float, hidden: Hidden) -> FloatArray:
    """What sensors make of what they see, before their noise."""
    return values + hidden.get("sensor bias", 0.0) + hidden.get("sensor drift per s", 0.0) * time_s


def _stepped(
    plant: Plant, x: list[float], u: float, hidden: Hidden, push: FloatArray, step_s: float
) -> list[float]:
    """A fine step by the midpoint rule."""
    at = x
    for share in (0.5, 1.0):
        rates = plant.rates(at, u, hidden)
        for i, p in zip(plant.pushed_at, push, strict=True):
            rates[i] += float(p)
        at = [v + share * step_s * r for v, r in zip(x, rates, strict=True)]
    return _met(at, hidden)


def _met(x: list[float], hidden: Hidden) -> list[float]:
    """Thrown back by a rigid wall, with a share of the speed (Newton's law of impact)."""
    wall, floor = hidden.get("wall", math.inf), hidden.get("floor", -math.inf)
    if x[0] > wall and x[1] > 0.0:
        return [wall, -hidden["bounce"] * x[1], *x[2:]]
    if x[0] < floor and x[1] < 0.0:
        return [floor, -hidden["bounce"] * x[1], *x[2:]]
    return x


def _wanted(plant: Plant, drive: str, time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """What is commanded: held random steps, a few waves, a sweep, or a way for a controller."""
    size = plant.reach if drive == "closed" else plant.drive
    held = plant.held * (2.0 if drive == "closed" else 1.0)
    if drive in ("steps", "closed"):
        every = max(round(held * plant.system.rate_hz), 1)
        row = np.repeat(rng.uniform(-1.7, 1.7, len(time_s) // every + 1), every)[: len(time_s)]
    elif drive == "waves":
        rates = rng.uniform(0.05, 0.8, 5) / held
        row = sum(np.sin(2 * np.pi * (f * time_s + rng.uniform())) for f in rates) / 1.6
    else:
        low, high = 0.05 / held, 0.6 / held
        span = time_s[-1] / 3
        at = np.mod(time_s, span)
        row = 1.4 * np.sin(2 * np.pi * (low * at + 0.5 * (high - low) / span * at**2))
    return np.asarray(size * row + (plant.mean if drive != "closed" else 0.0))


def _noise(rng: np.random.Generator, coloured: bool) -> FloatArray:
    """White noise of sd 1, or as much again that lasts some samples."""
    white = rng.standard_normal(SAMPLES)
    if not coloured:
        return white
    fresh = rng.standard_normal(SAMPLES) * (1.0 - _COLOUR**2) ** 0.5
    slow, value = np.empty(SAMPLES), float(rng.standard_normal())
    for k in range(SAMPLES):
        value = _COLOUR * value + float(fresh[k])
        slow[k] = value
    return 0.7 * (white + slow)


class Sensors:
    """What sensors make of what they see: the one at `sensor` may lag, be late, or tell less."""

    def __init__(self, hidden: Hidden, step_s: float, first: list[float]) -> None:
        self._hidden, self._step_s = hidden, step_s
        self._place = int(hidden.get("sensor", 0))
        late = round(hidden.get("sensor late", 0.0) / step_s)
        self._late = deque([first[self._place]] * (late + 1), maxlen=late + 1)
        self._lagged = first[self._place]

    def see(self, values: list[float]) -> None:
        """What is there in the next fine step."""
        self._late.append(values[self._place])
        lag = max(self._hidden.get("sensor lag", 0.0), self._step_s)
        self._lagged += (values[self._place] - self._lagged) * self._step_s / lag

    def read(self, values: list[float]) -> list[float]:
        """What they show of what is there now, before noise."""
        h, read = self._hidden, list(values)
        if "sensor lag" in h:
            read[self._place] = self._lagged
        if "sensor late" in h:
            read[self._place] = self._late[0]
        read[self._place] *= h.get("sensor gain", 1.0)
        read[self._place] += h.get("sensor bias", 0.0)
        return read


def controlled(plant: Controlled, hidden: Hidden, seed: int) -> Recording:
    """A recording of a plant under its controller, which sees no more than the sensors show."""
    rng = np.random.default_rng(seed)
    control = plant.controllers(rng, plant.samples)
    rate, outputs = plant.system.rate_hz, plant.system.outputs
    step_s = 1.0 / rate / _FINE
    x = list(plant.start)
    u = control(0, [0.0] * len(outputs), 1.0 / rate)
    sensors = Sensors(hidden, step_s, plant.shown(x, u, hidden))
    late = round(hidden.get("delay", 0.0) / step_s)
    commands = deque([u] * (late + 1), maxlen=late + 1)
    rows = []
    for k in range(plant.samples):
        noise = [float(o.noise or 0.0) * float(rng.standard_normal()) for o in outputs]
        pushes = [sd * float(rng.standard_normal()) for sd in plant.pushed]
        before = sensors.read(plant.shown(x, commands[0], hidden))
        u = control(k, [a + b for a, b in zip(before, noise, strict=True)], 1.0 / rate)
        now = sensors.read(plant.shown(x, u if late == 0 else commands[0], hidden))
        rows.append([*u, *(a + b for a, b in zip(now, noise, strict=True))])
        for i in range(_FINE):
            commands.append(u)
            x = _pushed(plant, x, commands[0], hidden, pushes, k / rate + i * step_s, step_s)
            sensors.see(plant.shown(x, commands[0], hidden))
    names = [*(i.name for i in plant.system.inputs), *(o.name for o in outputs)]
    columns = dict(zip(names, np.array(rows).T, strict=True))
    return Recording(f"controlled {seed}", np.arange(plant.samples) / rate, columns)


def _pushed(
    plant: Controlled,
    x: list[float],
    u: list[float],
    hidden: Hidden,
    pushes: list[float],
    time_s: float,
    step_s: float,
) -> list[float]:
    """A fine step by the midpoint rule."""
    at = x
    for share in (0.5, 1.0):
        rates = plant.rates(at, u, hidden, time_s)
        at = [v + share * step_s * (r + p) for v, r, p in zip(x, rates, pushes, strict=True)]
    return at
