"""Kinds that act as a force on a state: friction, springs, drag, hysteresis and what couples.

Each is written for one point and called with arrays; `at` is where the system is, `p` the
parameters. Dry friction is no force but a bound on one: see `physics.friction`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from wakedeploy.gap.systems.kinds.kind import FloatArray, Kind, Parameter, Parameters

_STILL = 0.02  # share of the usual speed over which a sign turns
AT_ONCE = 0.005  # the same of friction that turns at once
_STEEPEST = 50.0  # growth of a memory in a step, as an exponent
_EMPTY = 1e-9
_FORCE = {"force": 1}
_ARMSTRONG = "Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30, 1994"
_MECHANICS = "Landau and Lifshitz, Mechanics, 1976"


@dataclass(frozen=True)
class At:
    """Where a force acts: values of states by their part at the port, and the usual sizes."""

    speed: FloatArray
    position: FloatArray
    height: FloatArray
    force: FloatArray  # what the system itself computes there, without effects
    other: FloatArray  # what a coupling comes from
    own_states: tuple[FloatArray, ...]
    sizes: Any


class ForceKind(Kind):
    """Acts as a force; positive along the speed."""

    def force(self, at: At, p: Parameters) -> FloatArray:
        """What acts beside the system's own forces."""
        raise NotImplementedError

    def own_rates(self, at: At, p: Parameters) -> tuple[FloatArray, ...]:
        """Derivatives of the kind's own states."""
        return ()

    def own_corrections(
        self, at: At, faster: FloatArray, p: Parameters, step_s: float
    ) -> tuple[Any, ...]:
        """What `own_rates` lack of a step over which the speed changes evenly, by `faster`.

        A step that is linear around its begin knows neither where the speed turns within it, nor
        how a memory fades on a long way.
        """
        return (0.0,) * self.own_states


class Offset(ForceKind):
    """A constant force."""

    name = "offset"
    is_constant = True
    phrase = "a constant push on {port}"
    equation = "F"
    source = _MECHANICS
    parameters = (Parameter("force", _FORCE, starts=(0.1, -0.1)),)

    def force(self, at: At, p: Parameters) -> FloatArray:
        """The same everywhere."""
        return np.asarray(p["force"] + 0.0 * at.speed)


class Viscous(ForceKind):
    """Friction in proportion to speed."""

    name = "viscous-friction"
    phrase = "friction, or a leak, in proportion to {port}"
    between = "friction, or an exchange, in proportion to the difference of {first} and {second}"
    equation = "−b v"
    source = _ARMSTRONG
    parameters = (Parameter("coefficient", {"force": 1, "speed": -1}),)

    def force(self, at: At, p: Parameters) -> FloatArray:
        """Against the motion."""
        return np.asarray(-p["coefficient"] * at.speed)


class DryFriction(Kind):
    """Opposes a motion with its strength, and holds what stands with up to as much."""

    is_dry = True

    def strength(self, at: At, p: Parameters) -> FloatArray:
        """The most that it bears, not negative."""
        raise NotImplementedError

    def turning(self, at: At, p: Parameters) -> FloatArray:
        """The speed over which it turns, positive."""
        return np.asarray(_STILL * at.sizes["speed"] + 0.0 * at.speed)


class Coulomb(DryFriction):
    """Friction that depends on the sign of speed alone."""

    name = "coulomb-friction"
    phrase = "dry friction that acts on {port}"
    equation = "−F sign(v), soft below |v| = turning"
    source = _ARMSTRONG
    needs = ("still",)
    parameters = (
        Parameter("force", _FORCE, low=0.0, starts=(0.1, 0.01, 1.0)),
        Parameter("turning", {"speed": 1}, neutral=_STILL, low=AT_ONCE, high=0.2,
                  starts=(_STILL, _STILL, AT_ONCE), step=2e-4, prior=0.05),
    )  # fmt: skip

    def strength(self, at: At, p: Parameters) -> FloatArray:
        """The same at every speed."""
        return np.asarray(p["force"] + 0.0 * at.speed)

    def turning(self, at: At, p: Parameters) -> FloatArray:
        """As the log says."""
        return np.asarray(p["turning"] + 0.0 * at.speed)


class Stribeck(DryFriction):
    """Dry friction that falls as motion begins."""

    name = "stribeck-friction"
    simpler = ("coulomb-friction",)
    is_friction_law = True
    phrase = "dry friction on {port} that falls as motion begins"
    equation = "−F exp(−(v/speed)²) sign(v)"
    source = _ARMSTRONG
    needs = ("still",)
    parameters = (
        Parameter("force", _FORCE, low=0.0, starts=(0.1, 0.01, 1.0)),
        Parameter("speed", {"speed": 1}, neutral=0.3, low=0.05, high=2.0, starts=(0.3,), prior=0.5),
    )

    def strength(self, at: At, p: Parameters) -> FloatArray:
        """At small speeds only."""
        return np.asarray(p["force"] * np.exp(-((at.speed / p["speed"]) ** 2)))


class Presliding(ForceKind):
    """Dry friction that gives elastically before it slides."""

    name = "pre-sliding-friction"
    simpler = ("coulomb-friction",)
    is_friction_law = True
    is_dry = True
    phrase = "dry friction on {port} that gives elastically before it slides"
    between = "dry friction between {first} and {second} that gives elastically before it slides"
    equation = "−F z, length z' = v − |v| z"
    source = "Dahl, AIAA Journal 14, 1976"
    own_states = 1
    needs = ("still",)
    parameters = (
        Parameter("force", _FORCE, low=0.0),
        Parameter("length", {"position": 1}, neutral=0.03, low=0.002, high=2.0, starts=(0.03,),
                  prior=0.1),
    )  # fmt: skip

    def force(self, at: At, p: Parameters) -> FloatArray:
        """What the bent bristles bear."""
        return np.asarray(-p["force"] * at.own_states[0])

    def own_rates(self, at: At, p: Parameters) -> tuple[FloatArray, ...]:
        """The rate of the bristles' bending, which stays between −1 and 1."""
        return ((at.speed - np.abs(at.speed) * at.own_states[0]) / p["length"],)

    def own_corrections(
        self, at: At, faster: FloatArray, p: Parameters, step_s: float
    ) -> tuple[Any, ...]:
        """The bristles are bent back from where the speed turns."""
        return (_memory_correction(at, faster, p["length"], 0.0, step_s),)


class QuadraticDrag(ForceKind):
    """Drag of a fluid."""

    name = "quadratic-drag"
    phrase = "drag in proportion to the square of {port}"
    between = (
        "drag, or an exchange, that goes with the square of the difference of {first} and {second}"
    )
    equation = "−k v |v|"
    source = "Batchelor, An Introduction to Fluid Dynamics, 1967"
    parameters = (Parameter("coefficient", {"force": 1, "speed": -2}, low=0.0),)

    def force(self, at: At, p: Parameters) -> FloatArray:
        """Against the motion."""
        return np.asarray(-p["coefficient"] * at.speed * np.abs(at.speed))


class Stiffness(ForceKind):
    """A spring."""

    name = "stiffness"
    phrase = "a spring that acts on {port}"
    between = "a spring between {first} and {second}"
    equation = "−k x"
    source = _MECHANICS
    needs = ("position",)
    parameters = (Parameter("stiffness", {"force": 1, "position": -1}),)

    def force(self, at: At, p: Parameters) -> FloatArray:
        """Towards position 0."""
        return np.asarray(-p["stiffness"] * at.position)


class PreloadedSpring(ForceKind):
    """A spring that rests elsewhere than at position 0, as a buoyancy that changes with depth."""

    name = "preloaded-spring"
    simpler = ("stiffness", "offset")
    phrase = "a spring that acts on {port} and does not rest at position 0"
    equation = "F − k x"
    source = _MECHANICS
    needs = ("position",)
    parameters = (
        Parameter("stiffness", {"force": 1, "position": -1}),
        Parameter("preload", _FORCE, starts=(0.0, 0.0)),
    )

    def force(self, at: At, p: Parameters) -> FloatArray:
        """Towards where it rests; `preload` is what it bears at position 0."""
        return np.asarray(p["preload"] - p["stiffness"] * at.position)


class CubicStiffness(ForceKind):
    """A spring that hardens or softens."""

    name = "cubic-stiffness"
    phrase = "a spring on {port} that hardens or softens"
    between = "a spring between {first} and {second} that hardens or softens"
    equation = "−k x³"
    source = "Duffing, Erzwungene Schwingungen, 1918"
    needs = ("position",)
    parameters = (Parameter("coefficient", {"force": 1, "position": -3}, starts=(0.01, 0.1, 1.0)),)

    def force(self, at: At, p: Parameters) -> FloatArray:
        """Towards position 0, much more from afar."""
        return np.asarray(-p["coefficient"] * at.position**3)


class SquareStiffness(ForceKind):
    """A spring that differs to both sides."""

    name = "square-stiffness"
    phrase = "a spring on {port} that differs to both sides"
    equation = "−k x²"
    source = "Nayfeh and Mook, Nonlinear Oscillations, 1979"
    needs = ("position",)
    parameters = (Parameter("coefficient", {"force": 1, "position": -2}, starts=(0.1, -0.1)),)

    def force(self, at: At, p: Parameters) -> FloatArray:
        """To one side, from both."""
        return np.asarray(-p["coefficient"] * at.position**2)


class Gravity(ForceKind):
    """Weight at a turning axis."""

    name = "gravity"
    phrase = "weight that turns the axis of {port}"
    equation = "−s sin(angle) − c cos(angle)"
    source = _MECHANICS
    needs = ("position", "angle")
    parameters = (
        Parameter("sine", _FORCE, starts=(0.1, 1.0)),
        Parameter("cosine", _FORCE, starts=(0.0, 0.0)),
    )

    def force(self, at: At, p: Parameters) -> FloatArray:
        """Towards where the weight hangs."""
        return np.asarray(-p["sine"] * np.sin(at.position) - p["cosine"] * np.cos(at.position))


class Periodic(ForceKind):
    """A force that repeats along the way, as cogging."""

    name = "periodic-force"
    simpler = ("offset", "gravity")
    phrase = "a force on {port} that repeats along the way"
    equation = "s sin(2π x/length) + c cos(2π x/length)"
    source = "Hanselman, Brushless Motors, 2012"
    needs = ("position",)
    parameters = (
        Parameter("sine", _FORCE, starts=(0.1,) * 6),
        Parameter("cosine", _FORCE, starts=(0.1,) * 6),
        Parameter("length", {"position": 1}, neutral=0.2, low=0.01, high=1.0, prior=0.3,
                  starts=(0.03, 0.06, 0.1, 0.2, 0.35, 0.6)),
    )  # fmt: skip

    def force(self, at: At, p: Parameters) -> FloatArray:
        """A wave along the way."""
        phase = 2.0 * np.pi * at.position / p["length"]
        return np.asarray(p["sine"] * np.sin(phase) + p["cosine"] * np.cos(phase))


class Hysteresis(ForceKind):
    """A restoring force that remembers where the motion turned."""

    name = "hysteresis"
    simpler = ("coulomb-friction", "pre-sliding-friction")
    is_dry = True
    phrase = "a restoring force on {port} that remembers where the motion turned"
    between = "a force between {first} and {second} that remembers where the motion turned"
    equation = "−F z, length z' = v − |v| z − shape v |z|"
    source = "Wen, Journal of the Engineering Mechanics Division 102, 1976"
    own_states = 1
    needs = ("turning",)
    parameters = (
        Parameter("force", _FORCE, low=0.0, starts=(0.1, 1.0, 1.0)),
        Parameter("length", {"position": 1}, neutral=0.3, low=0.02, high=5.0,
                  starts=(0.3, 0.3, 1.0), prior=0.5),
        Parameter("shape", {}, low=-2.0, high=2.0, starts=(0.3, -0.9, -0.9), prior=1.0),
    )  # fmt: skip

    def force(self, at: At, p: Parameters) -> FloatArray:
        """What the memory bears."""
        return np.asarray(-p["force"] * at.own_states[0])

    def own_rates(self, at: At, p: Parameters) -> tuple[FloatArray, ...]:
        """The rate of the memory."""
        z, v = at.own_states[0], at.speed
        return ((v - np.abs(v) * z - p["shape"] * v * np.abs(z)) / p["length"],)

    def own_corrections(
        self, at: At, faster: FloatArray, p: Parameters, step_s: float
    ) -> tuple[Any, ...]:
        """The memory fades otherwise from where the speed turns, and from where it is empty."""
        return (_memory_correction(at, faster, p["length"], p["shape"], step_s),)


class AddedInertia(ForceKind):
    """More mass moves than the model says."""

    name = "added-inertia"
    phrase = "more mass, or less, that moves with {port} than is stated"
    equation = "(1 + ratio) m a = F"
    source = "Brennen, A Review of Added Mass, 1982"
    needs = ("inertia",)
    parameters = (Parameter("ratio", {}, low=-0.9, high=5.0, starts=(0.1, -0.1), prior=0.5),)

    def inputs_answered(self, sizes: Mapping[str, float]) -> float:
        """The stated mass over all that moves."""
        return 1.0 / (1.0 + sizes["ratio"])

    def force(self, at: At, p: Parameters) -> FloatArray:
        """The part of the system's own force that no longer accelerates it."""
        return np.asarray(-at.force * p["ratio"] / (1.0 + p["ratio"]))


class GroundEffect(ForceKind):
    """Lift near the ground."""

    name = "ground-effect"
    phrase = "lift on {port} near the ground"
    equation = "F exp(−height/reach)"
    source = "Cheeseman and Bennett, ARC R&M 3021, 1957"
    needs = ("height",)
    parameters = (
        Parameter("force", _FORCE, starts=(0.1, 1.0)),
        Parameter("reach", {"height": 1}, neutral=0.3, low=0.02, high=3.0, starts=(0.3,),
                  prior=0.5),
    )  # fmt: skip

    def force(self, at: At, p: Parameters) -> FloatArray:
        """Upwards, and gone some way up."""
        return np.asarray(p["force"] * np.exp(-np.maximum(at.height, 0.0) / p["reach"]))


class UpperRim(ForceKind):
    """An overflow: above a limit of a level, a strong flow acts back.

    A level has no speed of its own that could be taken away; what has one meets an `UpperStop`.
    The limit is near the end of the way: what is passed by more than a tenth of it is no stop.
    """

    name = "upper-stop"
    phrase = "a stop at the upper end that acts on {port}"
    equation = "−k max(x − limit, 0)"
    source = "Hunt and Crossley, Journal of Applied Mechanics 42, 1975"
    needs = ("position", "level")
    parameters: ClassVar[tuple[Parameter, ...]] = (
        Parameter("stiffness", {"force": 1, "range": -1}, low=0.0, high=3000.0,
                  starts=(1.0, 1.0, 10.0, 10.0, 100.0), step=0.1, prior=300.0),
        Parameter("limit", {"range": 1}, origin="highest", neutral=-0.05, low=-0.1, high=0.5,
                  starts=(-0.1, -0.05, -0.02, -0.05, -0.01), prior=0.1),
    )  # fmt: skip

    def force(self, at: At, p: Parameters) -> FloatArray:
        """Back from beyond the limit."""
        return np.asarray(-p["stiffness"] * _softened(at.position - p["limit"], p, at))


class LowerRim(ForceKind):
    """A bottom: below a limit of a level, a strong flow acts back."""

    name = "lower-stop"
    phrase = "a stop at the lower end that acts on {port}"
    equation = "k max(limit − x, 0)"
    source = UpperRim.source
    needs = UpperRim.needs
    parameters: ClassVar[tuple[Parameter, ...]] = (
        UpperRim.parameters[0],
        Parameter("limit", {"range": 1}, origin="lowest", neutral=0.05, low=-0.5, high=0.1,
                  starts=(0.1, 0.05, 0.02, 0.05, 0.01), prior=0.1),
    )  # fmt: skip

    def force(self, at: At, p: Parameters) -> FloatArray:
        """Back from beyond the limit."""
        return np.asarray(p["stiffness"] * _softened(p["limit"] - at.position, p, at))


_LOSS = Parameter("loss", {"speed": -1}, neutral=2.0, low=0.0, high=20.0, starts=(2.0,), prior=3.0)


class UpperStop(UpperRim):
    """An end stop: beyond a limit a strong force acts back, and takes speed away.

    It resists the more the faster it is met, and never holds back what leaves it.
    """

    equation = "−k max(x − limit, 0) max(1 + loss v, 0)"
    needs = ("position", "moving")
    parameters = (*UpperRim.parameters, _LOSS)

    def force(self, at: At, p: Parameters) -> FloatArray:
        """Back from beyond the limit."""
        return np.asarray(super().force(at, p) * np.maximum(1.0 + p["loss"] * at.speed, 0.0))


class LowerStop(LowerRim):
    """A floor, or an end stop at the other end."""

    equation = "k max(limit − x, 0) max(1 − loss v, 0)"
    needs = UpperStop.needs
    parameters = (*LowerRim.parameters, _LOSS)

    def force(self, at: At, p: Parameters) -> FloatArray:
        """Back from beyond the limit."""
        return np.asarray(super().force(at, p) * np.maximum(1.0 - p["loss"] * at.speed, 0.0))


class FreePlay(ForceKind):
    """A spring between two bodies that bears less, or nothing, near its middle, as teeth of gears.

    All of the model's own spring is taken away there if the stiffnesses are the same.
    """

    name = "free-play"
    phrase = "play at {port} in a spring, which bears less near its middle"
    between = "play between {first} and {second}, a spring that bears less near its middle"
    equation = "k x within ±width, ±k width beyond"
    source = "Nordin and Gutman, Automatica 38, 2002"
    needs = ("position",)
    parameters = (
        Parameter("stiffness", {"force": 1, "position": -1}, starts=(0.7, 0.7, 0.7)),
        Parameter("width", {"position": 1}, neutral=0.2, low=0.002, high=1.0, prior=0.3,
                  starts=(0.03, 0.1, 0.3)),
    )  # fmt: skip

    def force(self, at: At, p: Parameters) -> FloatArray:
        """What the spring lacks: along the difference, up to what it bears at the width."""
        return np.asarray(p["stiffness"] * np.clip(at.position, -p["width"], p["width"]))


class Coupling(ForceKind):
    """A force in proportion to another input, or to another axis's motion."""

    name = "coupling"
    phrase = "a force on {port} in proportion to {other}"
    equation = "k (other)"
    source = _MECHANICS
    needs = ("other",)
    parameters = (Parameter("coefficient", {"force": 1, "other": -1}, starts=(0.1, -0.1)),)

    def force(self, at: At, p: Parameters) -> FloatArray:
        """In proportion."""
        return np.asarray(p["coefficient"] * at.other)


def _memory_correction(
    at: At, faster: FloatArray, length: Any, shape: Any, step_s: float
) -> FloatArray:
    """What the rate of a memory z' = (v − |v| z − shape v |z|) / length lacks of a step.

    The speed changes evenly: the memory then follows the way before the turn and the way back, each
    in closed form. Of that the step knows what is linear around its begin. Without the rest a
    likelihood jumps where a turn moves into another step, and has many summits.
    """
    v, z = at.speed, at.own_states[0]
    forth = np.where(v < 0.0, -1.0, 1.0)
    on = forth * (v + faster)  # the speed at the end, along that of the begin
    share = np.where(on < 0.0, np.abs(v) / np.maximum(np.abs(faster), 1e-300), 1.0)
    there = step_s * share * 0.5 * (np.abs(v) + np.maximum(on, 0.0)) / length
    back = step_s * (1.0 - share) * 0.5 * np.maximum(-on, 0.0) / length
    turned = forth * _followed(forth * z, there, shape)
    exact = -forth * _followed(-forth * turned, back, shape) - z
    slope = -step_s * (np.abs(v) + shape * v * np.where(z < 0.0, -1.0, 1.0)) / length
    known = step_s * (1.0 - forth * z - shape * np.abs(z)) / length
    first, second = _mean_growths(slope)
    rate = step_s * (v - np.abs(v) * z - shape * v * np.abs(z)) / length
    return np.asarray((exact - rate * first - known * faster * second) / (step_s * first))


def _followed(y: FloatArray, ways: FloatArray, shape: Any) -> FloatArray:
    """A memory along the motion, after these ways in its lengths: y' = 1 − y − shape |y|."""
    fading = 1.0 - shape  # below 0, where it is led to 0
    led = np.maximum(-fading * y, _EMPTY - 1.0)
    until = np.where(np.abs(led) < _EMPTY, -y, -y * np.log1p(led) / np.where(led == 0.0, 1.0, led))
    before = np.where(y < 0.0, np.minimum(ways, np.maximum(until, 0.0)), 0.0)
    y = y + (1.0 - fading * y) * before * _mean_growths(-fading * before)[0]
    y = np.where(before < ways, np.maximum(y, 0.0), y)
    rest, fading = ways - before, 1.0 + shape
    return np.asarray(y + (1.0 - fading * y) * rest * _mean_growths(-fading * rest)[0])


def _mean_growths(slopes: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The means over a step of exp(s x), and of (1 − s) exp(s x), for s from 0 to 1."""
    x = np.clip(slopes, -_STEEPEST, _STEEPEST)
    x = np.where(np.abs(x) < 1e-4, 1e-4, x)
    first = np.expm1(x) / x
    return first, (first - 1.0) / x


def _softened(beyond: FloatArray, p: Parameters, at: At) -> FloatArray:
    """What exceeds 0, its corner rounded over a hundredth of the way.

    Over less if that much would bear more than the usual force: it would be felt from afar.
    """
    stiffness = np.maximum(p["stiffness"], 1e-300)
    round_ = np.minimum(0.01 * at.sizes["range"], at.sizes["force"] / stiffness)
    return np.asarray(0.5 * (beyond + np.sqrt(beyond**2 + round_**2)))


KINDS = (
    Offset(), Viscous(), Coulomb(), Stribeck(), Presliding(), QuadraticDrag(), Stiffness(),
    PreloadedSpring(), CubicStiffness(), SquareStiffness(), Gravity(), Periodic(), Hysteresis(),
    AddedInertia(), GroundEffect(), UpperStop(), LowerStop(), UpperRim(), LowerRim(), Coupling(),
)  # fmt: skip
# Between two bodies; dry friction there is a pre-sliding one, which gives by a hair.
BETWEEN = (
    Viscous(), Presliding(), QuadraticDrag(), Stiffness(), CubicStiffness(), Hysteresis(),
    FreePlay(),
)  # fmt: skip
