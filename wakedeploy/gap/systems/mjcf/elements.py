"""What of an MJCF file a system has: its joints and actuators, and the attributes that may be off.

In: a compiled model. Out: joints and actuators with the names of states and inputs, and attributes
with the names of constants. `reading` finds them in a file.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.gap.systems.mjcf.free_bodies import quaternion
from wakedeploy.gap.systems.system import FloatArray


@dataclass(frozen=True)
class Joint:
    """A joint that turns or slides: `name` as in the file, `word` as in names of the system.

    `qpos` and `dof` are its places in MuJoCo's state; `inertia` is what the joint alone moves in
    the pose of the file [kg m², kg for one that slides]. The six axes of a body that moves freely
    count as one each. They have the name of the `body` and the place where its orientation begins;
    an angle has a `speed_word` of its own, since its rate is not how fast the body turns.
    """

    name: str
    word: str
    turns: bool
    qpos: int
    dof: int
    inertia: float
    body: str = ""
    speed_word: str = ""

    @property
    def position(self) -> str:
        """The state that is its position."""
        return f"{self.word}_{'rad' if self.turns else 'm'}"

    @property
    def speed(self) -> str:
        """The state that is its speed."""
        return f"{self.speed_word or self.word}_{'radps' if self.turns else 'mps'}"

    @property
    def inertia_name(self) -> str:
        """The constant that is its inertia."""
        return f"{self.word}_inertia_{'kgm2' if self.turns else 'kg'}"


@dataclass(frozen=True)
class Actuator:
    """An actuator with one command; `act` is the place of its own state, −1 where it has none.

    `follows` is what its command asks for, "" where that has no unit of its own; it `integrates` or
    `filters` its command into its state. With `has_fixed_gain` its force is in proportion to them.
    `has_bias` says that an affine bias is beside that, `is_affine` that there is none of another
    kind. `wrench_unit` is that of a motor that pushes or turns a body by six gears, as a rotor at a
    site does; "1" where these mix several, "" for all other actuators. By `delay_s` its command
    acts later; `Elements.model` has none of that.
    """

    name: str
    word: str
    index: int
    act: int
    kind: str  # "position", "velocity", "motor" or "general"
    joint: str  # the joint on which it acts, "" for another transmission
    follows: str  # "position", "velocity", "pressure", "voltage", "force" or ""
    integrates: bool
    filters: bool
    has_fixed_gain: bool
    has_bias: bool
    is_affine: bool
    wrench_unit: str
    delay_s: float

    @property
    def command(self) -> str:
        """The input that is its command."""
        return f"{self.word}_command"

    @property
    def state(self) -> str:
        """The state that is its activation."""
        return f"{self.word}_activation"


@dataclass(frozen=True)
class Attribute:
    """A number of the file that may be off: `set` writes it into a compiled model.

    `element`, `of` and `attribute` are its place in the file; `spread` is a share of its value.
    """

    element: str
    of: str
    attribute: str
    value: float
    spread: float
    unit: str
    set: Callable[[Any, float], None]


@dataclass(frozen=True, eq=False)
class Elements:
    """A compiled model, and what a system has of it; `attributes` by the names of constants."""

    path: Path
    model: Any
    joints: tuple[Joint, ...]
    actuators: tuple[Actuator, ...]
    attributes: dict[str, Attribute]
    sensed: Mapping[str, float]  # the noise that sensors state of the states that they show
    coupled: tuple[tuple[str, ...], ...]  # joints that an equality holds to each other, or alone
    centres: Mapping[str, FloatArray]  # of mass of bodies that move freely, from the origin of each

    @property
    def free_angles(self) -> tuple[tuple[Joint, Joint, Joint], ...]:
        """Roll, pitch and yaw of each body that moves freely."""
        found = [j for j in self.joints if j.speed_word]
        return tuple((found[i], found[i + 1], found[i + 2]) for i in range(0, len(found), 3))

    def turns(self, actuator: Actuator) -> bool | None:
        """Whether the joint of an actuator turns; None where it acts on no joint of one axis."""
        joints = (j for j in self.joints if j.name == actuator.joint and not j.body)
        return next((j.turns for j in joints), None)

    def positions(self, states: FloatArray) -> FloatArray:
        """MuJoCo's positions (N, nq) where the joints are at `states` (N, joints)."""
        places = np.empty((len(states), self.model.nq))
        of = {joint.position: states[:, i] for i, joint in enumerate(self.joints)}
        for joint in self.joints:
            if not joint.speed_word:
                places[:, joint.qpos] = of[joint.position]
        for angles in self.free_angles:
            at = angles[0].qpos
            places[:, at : at + 4] = quaternion(*(of[a.position] for a in angles)).T
        return places
