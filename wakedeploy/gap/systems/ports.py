"""Places where effects may act on a system, and values by name as its functions get them.

In: names that the system states. Out: `Port`s, from which its effects follow, and `Point`s.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from wakedeploy.core.errors import UnusableInput

FloatArray = npt.NDArray[np.float64]
Increments = Callable[[FloatArray, "Point", "Point", "Point"], Mapping[str, Any]]

DIFFERENCE = "-"  # between two names: no state's name has it


@dataclass(frozen=True)
class Port:
    """A place where an effect may act.

    Made by `Port.input`, `.force`, `.between`, `.output`, `.constant` or `.custom`.

    `unit` is that of what the effect adds there; signals are (T,) along a log. A name that the
    system does not state raises UnusableInput when it is loaded.
    """

    role: str
    name: str
    inertia: str = ""
    position: str = ""
    height: str = ""
    unit: str = ""
    kinds: tuple[str, ...] = ()
    friction: str = ""
    like: str = ""
    function: Increments | None = field(default=None, compare=False)
    parameters: Mapping[str, tuple[str, float]] = field(default_factory=dict, compare=False)
    shapes: Mapping[str, tuple[str, float]] = field(default_factory=dict, compare=False)
    speeds: tuple[str, ...] = ()
    inertias: tuple[str, ...] = ()
    positions: tuple[str, ...] = ()
    ratio: float = 1.0

    @classmethod
    def input(cls, name: str, kinds: Sequence[str] | str = ()) -> "Port":
        """At a logged input, before it reaches the system; `kinds`, one or several, or all."""
        return cls("input", name, kinds=_several(kinds))

    @classmethod
    def force(
        cls,
        speed: str,
        inertia: str = "",
        position: str = "",
        height: str = "",
        unit: str = "",
        kinds: Sequence[str] | str = (),
        friction: str = "",
        like: str = "",
    ) -> "Port":
        """At the derivative of the state `speed`: a force over the constant `inertia`.

        Without an inertia an effect is a rate of the state, as an acceleration, or what `like`
        says. `position` is the state whose derivative the speed is, or another on which a force may
        depend, as a heading on a slope; `height` one that is the height above ground. `friction`
        names the constant that is the dry friction which the model knows of: it acts there beside
        the derivative, and holds what stands, which no function of the speed can do. `like` names
        the input that the force acts like, as more or less of it would: a torque in a joint of an
        arm moves the other joints, too, just as its motor's does, and is in the motor's unit;
        "-elbow_nm" is a motor that pushes backward. It goes without `inertia` and `unit`, and bends
        with that input where the model limits it.
        """
        return cls("force", speed, inertia, position, height, unit, _several(kinds), friction, like)

    @classmethod
    def between(
        cls,
        speeds: Sequence[str],
        inertias: Sequence[str] = (),
        positions: Sequence[str] = (),
        ratio: float = 1.0,
        unit: str = "",
        kinds: Sequence[str] | str = (),
    ) -> "Port":
        """Between two bodies, as in a gear, a belt or a spring: one is pulled, the other held back.

        `speeds` are the two states, `inertias` the constants that a force on each is over (or none:
        what one gains the other loses), `positions` the states whose rates the speeds are. A force
        depends on how far and how fast the first is ahead of the second. `ratio` says how often the
        first turns while the second turns once, or rad of the one for a metre of the other: that
        difference and the force are then on the second's side.
        """
        pairs = [_two("speeds", speeds)]
        pairs += [
            _two(n, g) if g else () for n, g in (("inertias", inertias), ("positions", positions))
        ]
        speeds, inertias, positions = pairs
        return cls(
            "between",
            DIFFERENCE.join(speeds),
            position=DIFFERENCE.join(positions),
            unit=unit,
            kinds=_several(kinds),
            speeds=speeds,
            inertias=inertias,
            positions=positions,
            ratio=ratio,
        )

    @classmethod
    def output(cls, name: str, kinds: Sequence[str] | str = ()) -> "Port":
        """At a sensor, between what the system does and what is logged."""
        return cls("output", name, kinds=_several(kinds))

    @classmethod
    def constant(cls, name: str, kinds: Sequence[str] | str = ()) -> "Port":
        """At a constant, which may then be another or change with time."""
        return cls("constant", name, kinds=_several(kinds))

    @classmethod
    def custom(
        cls,
        name: str,
        function: Increments,
        parameters: Mapping[str, tuple[str, float]],
        shapes: Mapping[str, tuple[str, float]] | None = None,
    ) -> "Port":
        """An effect of the user's own.

        `function(t, state, inputs, parameters)` returns what is added to the derivatives (or to
        the next states, where the system has a `step`). `parameters` gives each its unit and a
        usual size; at 0 the effect has to vanish. `shapes` are further parameters that say where or
        how it acts, as the width of a jet: positive, from a tenth to ten times the usual size.
        """
        for what, given in (("parameters", parameters), ("shapes", shapes or {})):
            if not isinstance(given, Mapping):
                raise UnusableInput(
                    f"The effect {name!r} has the {what} {given!r:.60}; give a unit and a usual "
                    'size by name, as {"strength_n": ("N", 0.1)}.'
                )
        return cls(
            "custom",
            name,
            function=function,
            parameters=dict(parameters),
            shapes=dict(shapes or {}),
        )

    def ahead(self, values: Mapping[str, Any], names: Sequence[str]) -> Any:
        """How much the first of two states is ahead of the second, on the second's side."""
        return values[names[0]] / self.ratio - values[names[1]]

    @property
    def acts_like(self) -> str:
        """The input that its force acts like, "" for none."""
        return self.like.removeprefix("-")

    @property
    def sign(self) -> float:
        """-1 where more of that input pushes backward, else 1."""
        return -1.0 if self.like.startswith("-") else 1.0

    def increments(self, time_s: Any, state: Any, inputs: Any, size: float) -> Mapping[str, Any]:
        """What an effect of the user's own adds at `size` times its parameters' usual sizes."""
        assert self.function is not None
        p = {name: size * usual for name, (_, usual) in self.parameters.items()}
        p |= {name: usual for name, (_, usual) in self.shapes.items()}
        return self.function(time_s, state, inputs, Point("parameter", p))


_OF_BOTH = {
    "speeds": '("motor_radps", "link_radps")',
    "inertias": '("motor_kgm2", "link_kgm2")',
    "positions": '("motor_rad", "link_rad")',
}


def _two(what: str, given: Sequence[str]) -> tuple[str, ...]:
    """Two names; UnusableInput for anything else."""
    is_pair = isinstance(given, tuple | list) and len(given) == 2
    if not is_pair or not all(isinstance(name, str) and name for name in given):
        raise UnusableInput(
            f"Port.between has the {what} {given!r:.60}; give those of both bodies, as "
            f"{what}={_OF_BOTH[what]}."
        )
    return tuple(given)


def _several(kinds: Sequence[str] | str) -> tuple[str, ...]:
    """Kinds as a tuple; a single one may be given alone, and a text is no list of its letters."""
    several = (kinds,) if isinstance(kinds, str) else kinds
    if not isinstance(several, Iterable) or not all(isinstance(kind, str) for kind in several):
        raise UnusableInput(f'A port has the kinds {kinds!r:.60}; give names, as ["lag", "gain"].')
    return tuple(several)


class Point:
    """Values by name, as attributes: `state.speed_mps`. An unknown name is an error by name."""

    def __init__(self, what: str, values: Mapping[str, Any]) -> None:
        self.__dict__.update(values)
        self.__dict__["_what"] = what

    def __getattr__(self, name: str) -> Any:
        known = ", ".join(n for n in self.__dict__ if n != "_what") or "none"
        raise AttributeError(f"{self.__dict__['_what']} {name!r} is not there; there are: {known}")
