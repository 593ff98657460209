"""The free parameters of a gantry's hypothesis: the place of each, and what it means.

In: a rig, its own effects, and those that a hypothesis names. Out: a `Layout` that turns parameters
into constants and effects with values. Noise comes first, then calibration, then the model's form,
then effects.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from wakedeploy.core.rig import Rig
from wakedeploy.gap.evidence.fits import Free
from wakedeploy.gap.systems.gantry.discrepancy import free_terms
from wakedeploy.gap.systems.gantry.flight import FloatArray
from wakedeploy.physics.constants import Constants, constants_of, spreads_of
from wakedeploy.physics.effects import LIBRARY, Effect, Parameter, replacing
from wakedeploy.physics.effects.chain import Chain, effect_of
from wakedeploy.physics.effects.symbolic import ExpressionForce

NOISE = (
    "noise.log_acceleration",
    "noise.log_turbulence",
    "noise.log_turbulence_time",
    "noise.log_range",
    "noise.range_slope",
)
_ACCELERATION = 0.03  # [m/s²·√s] white acceleration that friction's fine structure leaves
# A factor of 1.5. With a form that bends, few flights could be followed by a noise that is much too
# small; other flights then are not.
_NOISE_SD = 0.4
_WIDEST_SD = 5.0
# An effect's delay adds to the uncertainty of the calibrated delay.
_ADDED = {"command.delay_s", "range.delay_s"}
# Servo frames make the likelihood jagged in time; a difference must reach across a few of them.
_STEPS_S = {
    "command.delay_s": 0.002,
    "command.window_s": 0.001,
    "range.delay_s": 0.002,
    "range.hold_s": 0.0015,
}
_STEP = 0.05  # of a prior scale
# Flights know a thrust scale a hundred times as well as calibration does, and a term may be far
# beyond its typical size. With a longer step samples become outliers on the way, and derivatives
# are of that.
_SHORT_STEP = 0.005
_NEAR_S = 0.0015  # the part of a hold that repeats alone may leave open
_JAGGED_S = 1e-4  # the likelihood of a hold is jagged on this scale
HOLD, FRAME = "range.hold_s", "disturbance.esc_frame_s"


class Layout:
    """The place of each constant and effect parameter among the free parameters."""

    def __init__(
        self,
        rig: Rig,
        of_rig: Sequence[tuple[Effect, Mapping[str, Free]]],
        named: Sequence[Effect],
        held_s: Sequence[float] = (),
        frames_s: Sequence[float] = (),
    ) -> None:
        self._base = constants_of(rig)
        spreads = spreads_of(rig)
        names = {effect.name for effect in named}
        of_rig = [entry for entry in of_rig if entry[0].name not in names]
        acting = (*named, *(e for e, _ in of_rig))
        claimed = {p.constant for effect in acting for p in effect.parameters} - _ADDED
        free = list(_noise(rig))
        self._constants: list[tuple[int, str]] = []
        self._values: list[tuple[Effect, list[tuple[int, Parameter]]]] = []
        for constant, spread in spreads.items():
            if constant not in claimed:
                self._constants.append((len(free), constant))
                free.append(_nuisance(constant, self._base[constant], spread))
        for term in free_terms(rig):
            self._constants.append((len(free), term.name))
            free.append(term)
        for effect, known in of_rig:
            self._add(free, effect, known)
        for effect in named:
            self._add(free, effect, {})
        order = {name: i for i, name in enumerate(LIBRARY)}
        self._values.sort(key=lambda entry: order.get(entry[0].name, len(order)))
        self.free = tuple(_begun(f, held_s, frames_s) for f in free)

    def read(self, theta: FloatArray) -> tuple[Constants, Chain]:
        """Constants, and effects with their values."""
        constants = dict(self._base)
        for i, name in self._constants:
            constants[name] = float(theta[i])
        effects = []
        for effect, places in self._values:
            values = {p.name: float(theta[i]) for i, p in places}
            for _, p in places:
                if p.constant in _ADDED:
                    constants[p.constant] += values[p.name]
                elif p.constant is not None:
                    constants[p.constant] = values[p.name]
            effects.append((effect, values))
        return constants, Chain.in_order(tuple(effects))

    def _add(self, free: list[Free], effect: Effect, known: Mapping[str, Free]) -> None:
        places = []
        for p in effect.parameters:
            places.append((len(free), p))
            free.append(known.get(p.name) or _parameter(effect, p, self._base))
        self._values.append((effect, places))


def _noise(rig: Rig) -> tuple[Free, ...]:
    fraction = max(rig.disturbance.turbulence_fraction, 0.01)
    time_s = rig.disturbance.turbulence_time_s
    range_m = max(rig.range_sensor.noise_m, 0.0005)
    return (
        Free(NOISE[0], "", math.log(_ACCELERATION), _NOISE_SD, -8.0, 2.0, 0.05, first=0.0),
        Free(NOISE[1], "", math.log(fraction), _NOISE_SD, -7.0, 1.5, 0.05, first=-1.0),
        Free(NOISE[2], "", math.log(time_s), 0.5, -4.5, 1.0, 0.05),
        Free(NOISE[3], "", math.log(range_m), 0.5, -8.0, -2.0, 0.02),
        Free(NOISE[4], "", 0.0, 0.002, -0.003, 0.03, 1e-4),
    )


def _nuisance(constant: str, value: float, spread: float) -> Free:
    low = value - _WIDEST_SD * spread
    if constant.startswith(("rail.", "spool.", "wake.", "command.window")):
        low = max(low, 0.05 * value)
    return Free(
        constant,
        "",
        value,
        spread,
        low,
        value + _WIDEST_SD * spread,
        _STEPS_S.get(constant, _SHORT_STEP * spread),
        quantity=constant,
    )


def _parameter(effect: Effect, p: Parameter, base: Constants) -> Free:
    neutral = p.neutral_on(base)
    starts = tuple(min(max(neutral + s * p.scale, p.low), p.high) for s in p.starts)
    name = f"{effect.name}.{p.name}"
    is_smooth = isinstance(effect, ExpressionForce) or p.constant is not None
    share = _SHORT_STEP if is_smooth else _STEP
    step = _STEPS_S.get(p.constant or "", share * p.scale)
    quantity = "" if p.constant in _ADDED else p.constant or ""
    return Free(
        name,
        p.unit,
        neutral,
        3.0 * p.scale,
        p.low,
        p.high,
        step,
        starts,
        quantity,
        adds_to=p.constant if p.constant in _ADDED else "",
        scanned=_scanned(p),
        finest=p.finest,
        finest_share=p.summits_apart,
    )


def _begun(f: Free, held_s: Sequence[float], frames_s: Sequence[float]) -> Free:
    """A parameter whose fits start where the logs themselves point: a hold, a servo frame."""
    if frames_s and f.name in replacing(FRAME):
        return replace(f, starts=tuple(frames_s), scanned=tuple(frames_s))
    if not held_s or f.name not in replacing(HOLD):  # the rig's own hold is known
        return f
    return replace(
        f,
        starts=tuple(held_s),
        scanned=tuple(near_s for one_s in held_s for near_s in _around(one_s)),
        step=_JAGGED_S,
        finest=_JAGGED_S,
    )


def _around(size: float) -> tuple[float, ...]:
    """Sizes from half to twice this one, and close ones: a summit may be 0.1 ms wide."""
    far = size * np.geomspace(0.5, 2.0, 51)
    near = np.linspace(max(size - _NEAR_S, 0.5 * size), size + _NEAR_S, 61)
    return tuple(float(number) for number in np.unique(np.concatenate([far, near])))


def _scanned(p: Parameter) -> tuple[float, ...]:
    if p.scanned is None:
        return ()
    least, largest, ratio = p.scanned
    return tuple(np.geomspace(least, largest, 1 + round(math.log(largest / least, ratio))))


def own_effects(rig: Rig) -> list[tuple[Effect, dict[str, Free]]]:
    """The rig file's effects, each with its parameters' intervals as priors."""
    effects = []
    for entry in rig.effect:
        effect = effect_of(entry)
        known = {}
        for p in effect.parameters:
            stated = entry.parameters[p.name]
            spread = 0.05 * p.scale
            if stated.low is not None and stated.high is not None:
                spread = max((stated.high - stated.low) / 3.29, 1e-6 * p.scale)
            known[p.name] = Free(
                f"{effect.name}.{p.name}",
                p.unit,
                stated.value,
                spread,
                p.low,
                p.high,
                0.2 * spread,
            )
        effects.append((effect, known))
    return effects
