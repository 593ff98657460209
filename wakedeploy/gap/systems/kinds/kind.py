"""What every kind of effect has: a name, a phrase, an equation, parameters with sizes, a source."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from wakedeploy.gap.evidence.fits import Free

FloatArray = npt.NDArray[np.float64]
Parameters = Mapping[str, Any]  # by name, arrays that broadcast against the states


@dataclass(frozen=True)
class Scales:
    """How large things are at a port, from the log: sizes, units, and the time between samples.

    `sizes` and `units` are by what a parameter is made of: "input" ("largest" is how far from 0 it
    goes), "output" (about its mean), "top" and "bottom" (its largest and least reading),
    "constant", "force", "speed", "position", "height", "other", "time", "span" (of an uninterrupted
    log). "lowest" and "highest" are the ends of the way that the position goes, "range" is its
    length.
    """

    sizes: Mapping[str, float]
    units: Mapping[str, str]


@dataclass(frozen=True)
class Parameter:
    """A parameter of a kind: `neutral`, bounds and starts in multiples of its usual size.

    The usual size is `share` times a product of the port's scales, as `of` says: a viscous
    coefficient is {"force": 1, "speed": -1}. A size whose neutral value is not 0 is a shape. With
    an `origin`, as "lowest", they are counted from that scale. `scanned` are sizes each of which
    may have a summit of its own: then the curvature at one of them says little, and no standard
    error below the `finest_share` of a size is stated. `inverse` is what 1/size is called where
    people think in that.
    """

    name: str
    of: Mapping[str, int]
    share: float = 1.0
    neutral: float = 0.0
    low: float = -30.0
    high: float = 30.0
    starts: tuple[float, ...] = (0.1, 1.0)
    scanned: tuple[float, ...] = ()
    finest_share: float = 0.0
    step: float = 1e-3
    prior: float = 2.0
    origin: str = ""
    inverse: str = ""

    def size(self, scales: Scales) -> float:
        """The usual size, in the parameter's unit."""
        return self.share * math.prod(scales.sizes[k] ** p for k, p in self.of.items())

    def unit(self, scales: Scales) -> str:
        """The unit, put together from those of the port."""
        over = [_power(scales.units[k], p) for k, p in self.of.items() if p > 0]
        under = [_power(scales.units[k], -p) for k, p in self.of.items() if p < 0]
        over, under = [u for u in over if u != "1"], [u for u in under if u != "1"]
        top, below = " ".join(over) or "1", " ".join(under)
        if not under:
            return top
        is_one = len(under) == 1 and (below[0] == "(" or not set(below) & set(" /"))
        return f"{top}/{below}" if is_one else f"{top}/({below})"

    def free(self, effect: str, scales: Scales) -> Free:
        """As a fit sees it."""
        size, origin = self.size(scales), scales.sizes[self.origin] if self.origin else 0.0
        scanned = tuple(origin + s * size for s in self.scanned)
        starts = (*(origin + s * size for s in self.starts), *scanned)
        ends = origin + self.low * size, origin + self.high * size
        name, unit = f"{effect}.{self.name}", self.unit(scales)
        neutral = origin + self.neutral * size
        return Free(
            *(name, unit, neutral, self.prior * size, *ends, self.step * size, starts),
            scanned=scanned,
            finest_share=self.finest_share,
        )


class Kind:
    """A kind of effect. `equation` is for a person, `source` says where it is from.

    `phrase` says what a system lacks that lacks it, of `{port}` and, of a coupling, of `{other}`;
    `between` says it of two bodies, `{first}` and `{second}`.
    `simpler` are kinds that it is the same as with more to it; `is_friction_law` says that it is a
    finer law of what the simpler one is, and nothing else.
    """

    name: ClassVar[str]
    phrase: ClassVar[str] = ""
    between: ClassVar[str] = ""
    equation: ClassVar[str]
    source: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    own_states: ClassVar[int] = 0
    simpler: ClassVar[tuple[str, ...]] = ()
    is_friction_law: ClassVar[bool] = False
    is_dry: ClassVar[bool] = False  # it holds what stands against a small push
    is_constant: ClassVar[bool] = False  # it is the same whatever moves
    is_delay: ClassVar[bool] = False
    is_gain: ClassVar[bool] = False
    is_slow: ClassVar[bool] = False  # what it acts on takes time to follow
    # Of a port: "position", "height", "inertia", "angle", "moving" where its state is the speed of
    # its position, "level" where it is not. Of the logs: "turning" is a sign that changes, "still"
    # one that does or that comes near 0, "cut above" and "cut below" that several readings are the
    # last to one side. Without, the kind is another's double, or not there.
    needs: ClassVar[tuple[str, ...]] = ()

    def inputs_answered(self, sizes: Mapping[str, float]) -> float:
        """What inputs do with an effect of these sizes, as a share of what they do without."""
        return 1.0


def pace(tau_s: FloatArray, dt_s: float, discrete: bool, least_s: float) -> FloatArray:
    """Share of what a state is away from its value that goes in a second.

    A time constant counts as `least_s` at least.
    """
    tau_s = np.maximum(tau_s, least_s)
    return np.asarray(-np.expm1(-dt_s / tau_s) / dt_s if discrete else 1.0 / tau_s)


def _power(unit: str, exponent: int) -> str:
    """A unit to a power; (m/s)² and not m/s², which is another."""
    if exponent == 1 or unit == "1":
        return unit
    raised = {2: "²", 3: "³"}.get(exponent, f"^{exponent}")
    return f"({unit}){raised}" if set(unit) & set(" /") else f"{unit}{raised}"
