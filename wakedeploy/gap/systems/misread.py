"""Columns in another unit, of another sign, or exchanged: a system explains its logs far better so.

In: a `LogModel`, before any fit. Out: sentences. Each column is read in other units of its
dimension and with the other sign, and each two are exchanged; what counts is how far the system,
with its constants as stated, is off a forecast later, and whether a position goes on as its
measured speed says.
"""

import copy
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Origin, Recording
from wakedeploy.core.units import conversion, is_angular, same_dimension
from wakedeploy.gap.evidence.fits import FloatArray
from wakedeploy.gap.systems.likelihood.augmented import Acting
from wakedeploy.gap.systems.likelihood.blocks import IntArray
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.system import Constant, Output, StateSpace
from wakedeploy.gap.wording import quantity

_UNITS = (
    "m", "cm", "mm", "in", "ft", "rad", "deg", "rev", "rad/s", "deg/s", "rpm", "rps", "m/s", "cm/s",
    "mm/s", "kmh", "knots", "m/s^2", "mm/s^2", "N", "mN", "kN", "gf", "kgf", "lbf", "N m", "mN m",
    "N mm", "V", "mV", "A", "mA", "W", "mW", "kW", "Pa", "kPa", "mbar", "bar", "psi", "kg", "g",
    "Hz", "1/min", "l/min", "m^3/s", "1", "%",
)  # fmt: skip
_OTHER_SIGN = " has the other sign"
_GRAVITIES, _GRAVITY = "g, 9.81 m/s²", 9.80665
_ROWS, _LOGS, _PLACES, _DEAR_PLACES = 3000, 2, 200, 40  # that are looked at
_FEWEST_ROWS, _AT_FULL_LENGTH = 500, 12  # of rows; more readings than these see fewer of them
_LONGER, _FARTHEST = (1, 4), 400  # times a forecast, and samples
_FEWEST_PLACES = 20
_WELL = 0.1  # of what holding the last reading leaves: a system that is off by less reads well
_AS_GOOD = 1.1
_HALF = 0.5  # of the error has to go
_EXPLAINED = 0.7  # of what holding the last reading leaves: so much has to go in the end
_SHARP = 0.7  # of the error with twice and half the unit: else any small, or large, one will do
_UNTOUCHED, _WORSE = 0.05, 1.2  # an output whose error changes by less; one that gets worse
_SPREADS = 3.0  # of constants, within which a scale may be theirs
_FAR = 1e6  # of its spread: where an output ends that is no number
_GOES_ON, _DOES_NOT = 0.3, 0.7  # share of a position's way that its speed leaves unexplained
_ALIKE, _OFF_SCALE = 0.95, 0.25  # correlation of way and speed; of a scale from 1, and of a unit


@dataclass(frozen=True)
class _Other:
    """Another reading of the logs: what it is, and the columns that it makes of a recording's."""

    words: str
    columns: Callable[[Mapping[str, FloatArray]], dict[str, FloatArray]]
    scale: float = 1.0
    name: str = ""


def misread(model: LogModel) -> list[str]:
    """A sentence for each column that seems to be in another unit, or in the place of another.

    Of a system with constants that nobody has measured, only what positions and their speeds say
    of each other: such constants take up any scale.
    """
    notes = _of_noise(model) or _of_speeds(model)
    unlimited = any(math.isinf(c.spread) for c in model.system.constants)
    return notes or ([] if unlimited else _of_forecasts(model))


# --- by noise


def _of_noise(model: LogModel) -> list[str]:
    """Outputs that move by less than the noise that the system states: no unit of theirs is it."""
    moved = zip(model.system.outputs, _outputs(model), strict=True)
    spans = [(o, float(np.nanquantile(row, 0.99) - np.nanquantile(row, 0.01))) for o, row in moved]
    return [
        f"output {o.name} moves by {quantity(span, o.unit)} in all, less than the noise that the "
        f"system states of it, {quantity(o.noise, o.unit)}: is its unit right?"
        for o, span in spans
        if o.noise is not None and 0.0 < span < o.noise
    ]


# --- by forecasts


def _of_forecasts(model: LogModel) -> list[str]:
    """The readings under which errors of forecasts all but vanish, the best and those as good."""
    logs = _Logs.of(model)
    system, before = logs.system, logs.errors()
    origins = _origins(model)
    others = [*_in_other_units(system, before, origins), *_exchanged(system, before, origins)]
    if len(others) > _AT_FULL_LENGTH:
        logs = logs.shortened(_AT_FULL_LENGTH / len(others))
        before = logs.errors()
    others += _of_other_sign(logs, before)
    each = [(_shares(logs, before, other), other) for other in others]
    for ahead in sorted(before):
        readings = [
            (shares[ahead], other)
            for shares, other in each
            if shares[ahead] < _HALF and _is_sharp(logs, before, other, ahead, shares[ahead])
        ]
        best = min((share for share, _ in readings), default=1.0)
        words = [other.words for share, other in readings if share <= _AS_GOOD * best]
        if words:
            return [
                "with the constants as stated the system explains these logs far better if "
                f"{_joined(words)}: {ahead * model.dt_s:.3g} s ahead it is off by {best:.2g} "
                "times what it is now. Check the unit and the sign of each column, and which is "
                "which."
            ]
    return []


def _origins(model: LogModel) -> dict[str, Origin]:
    """What columns were read from, where it is the same in all logs."""
    first, *others = (recording.origins for recording in model.recordings)
    return {n: o for n, o in first.items() if all(other.get(n) == o for other in others)}


def _joined(words: Sequence[str]) -> str:
    """Readings, one of which will be right; what several columns have in common is said once."""
    turned = [w.removesuffix(_OTHER_SIGN) for w in words if w.endswith(_OTHER_SIGN)]
    rest = [w for w in words if not w.endswith(_OTHER_SIGN)]
    return " or ".join(rest + ([" or ".join(turned) + _OTHER_SIGN] if turned else []))


@dataclass(frozen=True)
class _Logs:
    """What is looked at: a system, the beginnings of logs, and how many places in each look."""

    system: StateSpace
    recordings: tuple[Recording, ...]
    places: int

    @classmethod
    def of(cls, model: LogModel) -> "_Logs":
        """A model's first logs; its system without ports, as to offer effects takes long."""
        system = copy.copy(model.system)
        system.ports = ()  # type: ignore[misc]
        recordings = tuple(_beginning(r, _ROWS) for r in model.recordings[:_LOGS])
        return cls(system, recordings, _DEAR_PLACES if system.costs_by_point else _PLACES)

    def shortened(self, share: float) -> "_Logs":
        """Less of them, where much is to be tried."""
        rows = max(round(share * _ROWS), _FEWEST_ROWS)
        recordings = tuple(_beginning(r, rows) for r in self.recordings)
        return replace(
            self, recordings=recordings, places=max(round(share * self.places), _DEAR_PLACES)
        )

    def read_as(self, other: "_Other") -> "_Logs":
        """The same, read otherwise."""
        read = (replace(r, columns=other.columns(r.columns)) for r in self.recordings)
        return replace(self, recordings=tuple(read))

    def errors(self) -> dict[int, FloatArray]:
        """How far each output (m,) is off a forecast later, in what its last reading is off.

        By the samples of the forecast: soon an output goes on as it went, whatever drives it. The
        median of many places, for a log may have a moment in which anything runs away. Nothing
        where the functions of the system do not bear these numbers.
        """
        try:
            model = LogModel(self.system, self.recordings)
            acting = Acting(self.system, (), model.sizes)
            with np.errstate(all="ignore"):
                return {
                    ahead: _off(model, acting, at, ahead)
                    for ahead in (k * model.horizon for k in _LONGER)
                    if ahead <= _FARTHEST
                    and len(at := _places(model, ahead, self.places)) >= _FEWEST_PLACES
                }
        except UnusableInput:
            return {}


def _are_off(system: StateSpace, errors: Mapping[int, FloatArray]) -> list[Output]:
    """The outputs with a forecast that is off by so much that a column may be read wrongly."""
    worst = np.max([*errors.values()], axis=0) if errors else np.zeros(len(system.outputs))
    return [o for o, off in zip(system.outputs, worst, strict=True) if off > _WELL]


def _in_other_units(
    system: StateSpace, errors: Mapping[int, FloatArray], origins: Mapping[str, Origin]
) -> Iterator[_Other]:
    """Columns in units in which they may have been logged, beyond what constants allow.

    Of outputs only those that are off; of inputs all, if any output is. None whose log says its
    unit: something that is missing may look like another one.
    """
    least = _SPREADS * max((_relative(c) for c in system.constants), default=0.0)
    off = _are_off(system, errors)
    stated = [(f"input {i.name}", i.name, i.unit) for i in system.logged if off]
    stated += [(f"output {o.name}", o.name, o.unit) for o in off]
    for what, name, unit in stated:
        origin = origins.get(name)
        if origin is not None and origin.is_stated:
            continue
        for words, scale in _readings(what, unit, origin):
            if abs(math.log(scale)) > max(least, _OFF_SCALE):
                yield _scaled(words, name, scale)


def _relative(constant: Constant) -> float:
    """How far a constant may be off, as the logarithm of a scale; 0 for one about 0."""
    return math.log1p(constant.spread / abs(constant.value)) if constant.keeps_sign else 0.0


def _readings(what: str, unit: str, origin: Origin | None) -> list[tuple[str, float]]:
    """What may be wrong about a column's unit, and what its numbers are then multiplied by.

    It is in another unit than its columns.toml says. Of a column that nobody says that of, it is in
    another than the system's, or was in the system's before it was converted all the same.
    Two of one scale, as kN and mN, are one.
    """
    said: dict[float, list[str]] = {}
    is_known = origin is not None and origin.unit not in ("", "1")  # which nobody has stated
    read_as = origin.unit if origin is not None and is_known else unit
    stated, units = read_as or "1", [*_units_of(read_as)]
    for other, scale in units:
        said.setdefault(_rounded(scale), []).append(f"{what} is in {other}, and not in {stated}")
    for other, scale in () if is_known else units:
        if other == _GRAVITIES:  # which no columns.toml can say
            continue
        times = 1.0 / scale
        said.setdefault(_rounded(times), []).append(
            f"{what} is {times:.4g} times as large as was read, as where numbers that were in "
            f"{stated} already were converted from {other}"
        )
    return [(" or ".join(words), scale) for scale, words in said.items()]


def _rounded(scale: float) -> float:
    return float(f"{scale:.9g}")


def _units_of(unit: str) -> Iterator[tuple[str, float]]:
    """Units of the same dimension, and what a number in each is multiplied by."""
    for other in _UNITS:
        if same_dimension(other, unit) and is_angular(other) == is_angular(unit):
            scale = float(conversion(other, unit))
            if scale != 1.0:
                yield other, scale
    if same_dimension("m/s^2", unit):
        yield _GRAVITIES, _GRAVITY * float(conversion("m/s^2", unit))


def _scaled(words: str, name: str, scale: float) -> _Other:
    return _Other(words, lambda c: {**c, name: scale * c[name]}, scale, name)


def _of_other_sign(logs: _Logs, errors: Mapping[int, FloatArray]) -> Iterator[_Other]:
    """Inputs and outputs that are off with the other sign: nobody agrees on axes.

    An input that is never negative, as a pulse's width, has no sign. A position and its speed may
    be of one encoder, and turn together.
    """
    system, off = logs.system, _are_off(logs.system, errors)
    for stated in system.logged if off else ():
        if any(np.nanmin(r.columns[stated.name]) < 0.0 for r in logs.recordings):
            yield _turned(f"input {stated.name}{_OTHER_SIGN}", stated.name)
    for shown in off:
        yield _turned(f"output {shown.name}{_OTHER_SIGN}", shown.name)
    for place, speed in _places_and_speeds(system):
        if {place, speed} <= {o.name for o in off}:
            words = f"outputs {place} and {speed} both have the other sign"
            yield _turned(words, place, speed)


def _turned(words: str, *names: str) -> _Other:
    return _Other(words, lambda c: {**c, **{n: -1.0 * c[n] for n in names}})


def _exchanged(
    system: StateSpace, errors: Mapping[int, FloatArray], origins: Mapping[str, Origin]
) -> Iterator[_Other]:
    """Each two of the outputs that are off and the inputs, in each other's place.

    An input and an output only where units allow: they have one dimension, or no log says them.
    """
    off = _are_off(system, errors)
    inputs = system.logged if off else []
    for what, alike in (("outputs", off), ("inputs", inputs)):
        for a, b in itertools.combinations([each.name for each in alike], 2):
            yield _swapped(f"the {what} {a} and {b} are exchanged", a, b)
    stated = {n for n, origin in origins.items() if origin.is_stated}
    for given, shown in itertools.product(inputs, off):
        a, b = given.name, shown.name
        if same_dimension(given.unit, shown.unit) or not stated & {a, b}:
            yield _swapped(f"input {a} and output {b} are exchanged", a, b)


def _swapped(words: str, a: str, b: str) -> _Other:
    return _Other(words, lambda c: {**c, a: c[b], b: c[a]})


def _is_sharp(
    logs: _Logs, before: Mapping[int, FloatArray], other: _Other, ahead: int, share: float
) -> bool:
    """Whether the unit's size is what it takes: not any that makes a column small, or large."""
    if not other.name:
        return True
    near = (_scaled("", other.name, k * other.scale) for k in (0.5, 2.0))
    return all(share < _SHARP * _shares(logs, before, each, explains=False)[ahead] for each in near)


def _shares(
    logs: _Logs, before: Mapping[int, FloatArray], other: _Other, *, explains: bool = True
) -> dict[int, float]:
    """What is left of the errors of those outputs that change, by the samples of a forecast.

    Infinite where some get worse or, where it is to explain them, still are far off.
    """
    after = logs.read_as(other).errors()
    return {
        ahead: _share(off, after[ahead], explains) if ahead in after else math.inf
        for ahead, off in before.items()
    }


def _share(before: FloatArray, after: FloatArray, explains: bool) -> float:
    ratio = np.maximum(after, 1.0 / _FAR) / np.maximum(before, 1.0 / _FAR)
    touched = np.abs(ratio - 1.0) > _UNTOUCHED
    if not touched.any():
        return 1.0
    if explains and (ratio.max() > _WORSE or after[touched].max() > _EXPLAINED):
        return math.inf
    return float(np.exp(np.mean(np.log(ratio[touched]))))


def _off(model: LogModel, acting: Acting, at: IntArray, ahead: int) -> FloatArray:
    """How far each output (m,) is off after these samples (S,)."""
    shown = model.filter.advanced(acting, {"nothing": np.zeros(1)}, at, ahead)
    found = []
    for measured, predicted in zip(_outputs(model), shown, strict=True):
        later = measured[at + ahead]
        known = np.isfinite(later)
        off = np.nan_to_num(np.abs(predicted - later)[known], nan=np.inf)
        held = np.abs(_held(measured)[at] - later)[known]
        scale = max(float(np.median(held)), float(np.nanstd(measured)) / _FAR) if len(held) else 0.0
        found.append(min(float(np.median(off)) / scale, _FAR) if scale else 1.0)
    return np.array(found)


def _places(model: LogModel, ahead: int, count: int) -> IntArray:
    """Up to so many samples (S,) after which a forecast lies in the same log."""
    ends = np.cumsum([0, *(log.outputs.shape[1] for log in model.logs)])
    each = [np.arange(a, b - ahead) for a, b in itertools.pairwise(ends)]
    free = np.concatenate(each).astype(np.int64)
    return free[
        np.unique(np.linspace(0, max(len(free) - 1, 0), count).astype(np.int64))[: len(free)]
    ]


def _outputs(model: LogModel) -> FloatArray:
    return np.concatenate([log.outputs for log in model.logs], axis=1)


def _held(measured: FloatArray) -> FloatArray:
    """The newest reading at each sample, and the first before it."""
    known = np.isfinite(measured)
    newest = np.maximum.accumulate(np.where(known, np.arange(len(known)), -1))
    return np.asarray(measured[np.where(newest < 0, int(np.argmax(known)), newest)])


def _beginning(recording: Recording, rows: int) -> Recording:
    columns = {name: values[:rows] for name, values in recording.columns.items()}
    return replace(recording, time_s=recording.time_s[:rows], columns=columns)


# --- by positions and their speeds


def _of_speeds(model: LogModel) -> list[str]:
    """Positions that do not go on as the output says that shows their speed."""
    notes = []
    names = [o.name for o in model.system.outputs]
    ways = {name: _ways(model, k) for k, name in enumerate(names)}
    for place, speed in _places_and_speeds(model.system):
        way, by_speed = ways[place][0], ways[speed][1]
        if _unexplained(way, by_speed) < _DOES_NOT:
            continue
        better = [n for n in names if n != place and _unexplained(way, ways[n][1]) < _GOES_ON]
        if _unexplained(ways[speed][0], ways[place][1]) < _GOES_ON:
            notes.append(
                f"output {speed} goes on as {place} says, as if that were its speed: are the two "
                "columns exchanged?"
            )
        elif better:
            notes.append(
                f"output {place} goes on as {' and '.join(better)} says, and not as {speed}, which "
                "the system has as its speed: are columns exchanged?"
            )
        else:
            notes += _of_scale(model, place, speed, way, by_speed)
    return notes


def _places_and_speeds(system: StateSpace) -> Iterator[tuple[str, str]]:
    """Every two outputs of which one shows a state, and the other the rate of that state."""
    shown = {state: name for name, state in system.shown_states().items()}
    for state, rate in system.kinematic().items():
        if state in shown and rate in shown:
            yield shown[state], shown[rate]


def _ways(model: LogModel, k: int) -> tuple[FloatArray, FloatArray]:
    """How far an output goes over a forecast (S,), and its sum over time meanwhile."""
    at, ahead = _places(model, model.horizon, _PLACES), model.horizon
    measured = _outputs(model)[k]
    there = np.arange(len(measured))
    known = np.isfinite(measured)
    filled = np.interp(there, there[known], measured[known])
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (filled[1:] + filled[:-1]))]) * model.dt_s
    return filled[at + ahead] - filled[at], summed[at + ahead] - summed[at]


def _unexplained(way: FloatArray, by: FloatArray) -> float:
    """What is left of a way, in root mean squares, by what a speed says; infinite for no way."""
    size = float(np.sqrt(np.mean(way**2))) if len(way) else 0.0
    return float(np.sqrt(np.mean((way - by) ** 2))) / size if size else math.inf


def _of_scale(
    model: LogModel, place: str, speed: str, way: FloatArray, by_speed: FloatArray
) -> list[str]:
    """A position and a speed that go together by another scale than 1, or the other way."""
    sizes = float(np.sqrt(np.sum(way**2) * np.sum(by_speed**2)))
    alike = float(np.sum(way * by_speed)) / sizes if sizes else 0.0
    if alike < -_ALIKE:
        return [
            f"output {place} goes the other way than its speed, {speed}, says: turn the sign of "
            "one of the two, in columns.toml by scale = -1."
        ]
    if alike < _ALIKE:
        return []
    scale = float(np.sqrt(np.sum(way**2) / np.sum(by_speed**2)))
    units = {o.name: o.unit for o in model.system.outputs}
    origins = _origins(model)
    unsure = [n for n in (place, speed) if n not in origins or not origins[n].is_stated]
    likely = [
        words
        for name, wanted in ((place, 1.0 / scale), (speed, scale))
        if name in unsure
        for words, factor in _readings(name, units[name], origins.get(name))
        if abs(math.log(factor / wanted)) < _OFF_SCALE
    ]
    if not likely:
        return []
    return [
        f"output {place} goes {scale:.3g} times as far as its speed, {speed}, says. That fits if "
        f"{', or if '.join(likely)}: is each column's unit right?"
    ]
