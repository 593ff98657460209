"""A system whose rates are those of a MuJoCo model.

A rate is MuJoCo's forward dynamics at a point, for many points and many constants at once through
its own `rollout`: one tiny explicit Euler step of each, whose rise over its time is the rate.
"""

import importlib
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.systems.mjcf.elements import Elements
from wakedeploy.gap.systems.mjcf.free_bodies import angle_rates, turning, twist
from wakedeploy.gap.systems.mjcf.ranges import CORRECTED, RANGES
from wakedeploy.gap.systems.mjcf.reading import loaded_mujoco, read_elements
from wakedeploy.gap.systems.own_system import System
from wakedeploy.gap.systems.ports import Point
from wakedeploy.gap.systems.system import FloatArray

if TYPE_CHECKING:
    from wakedeploy.gap.search.artefacts import Answer

_STEP_S = 2.0**-14  # a power of two: dividing by it loses nothing
# States, where a body is in the world, and forces: MuJoCo would warn of a point beyond.
_FARTHEST, _FARTHEST_M, _STRONGEST = 1e4, 1e9, 1e6
_MOST_MODELS = 2048  # models with constants of their own that are kept
_MOST_SHAPES = 8  # of points whose models are remembered
_WORTH_THREADS = 64  # points from which threads are quicker


class MjcfSystem(System):
    """A MuJoCo model: `mjcf` is its file, and the names are those that `gap init --mjcf` writes.

    States are `<joint>_rad` and `<joint>_radps` (`_m` and `_mps` for slides), inputs
    `<actuator>_command`, outputs positions or speeds of joints; each is (N,) where N points are
    tried at once, in SI units. A body that moves freely has `<body>_x_m`, `_y_m` and `_z_m` with
    `<body>_x_mps` and so on along the world's axes; `<body>_roll_rad`, `_pitch_rad` and `_yaw_rad`
    of its origin's frame; and `<body>_p_radps`, `_q_radps` and `_r_radps`, by which it turns about
    its own axes. Constants are attributes of the file that may be off; one that is left away stays
    as the file has it. Forces at ports act through the mass matrix. UnusableInput says by name what
    the file does not have, and what is damaged in it.
    """

    mjcf: ClassVar[str | Path]
    costs_by_point: ClassVar[bool] = True
    exported: ClassVar[Sequence[str]] = (CORRECTED, RANGES)

    def __init__(self) -> None:
        self._elements = read_elements(Path(self.mjcf))
        self._names = _checked_names(self, self._elements)
        self._farthest = np.full(len(self.states), _FARTHEST)
        for place, joint in enumerate(self._elements.joints):
            if joint.body and not joint.turns:
                self._farthest[place] = _FARTHEST_M
        self._models: dict[bytes, Any] = {}
        self._latest: dict[tuple[int, ...], tuple[Any, list[Any]]] = {}  # by the points' shape
        self._library = loaded_mujoco(Path(self.mjcf))
        self._plain = _explicit(self._library, self._elements.model)
        self._rollout: Any = None

    @property
    def elements(self) -> Elements:
        """The model, its joints and its actuators."""
        return self._elements

    def derivative(self, state: Point, inputs: Point, c: Point) -> dict[str, Any]:
        """Speeds, accelerations and the rates of activations, each as its states' shape."""
        return self.derivative_under(state, inputs, c, {})

    def derivative_under(
        self, state: Point, inputs: Point, c: Point, forces: Mapping[str, Any]
    ) -> dict[str, Any]:
        """The same with forces on joints, by the name of the joint's speed [N m, N].

        Those along the world's axes act at the centre of mass of what moves freely, and turn
        nothing.
        """
        joints, actuators = self._elements.joints, self._elements.actuators
        forces = self._at_centres(state, forces)
        acting = [a for a in actuators if a.act >= 0]
        states = [
            *(getattr(state, j.position) for j in joints),
            *(getattr(state, j.speed) for j in joints),
            *(getattr(state, a.state) for a in acting),
        ]
        driven = [
            *(getattr(inputs, a.command) for a in actuators),
            *(forces.get(j.speed, 0.0) for j in joints),
        ]
        constants = [np.asarray(getattr(c, name), dtype=float) for name in self._names]
        shape = np.broadcast_shapes(*(np.shape(v) for v in (*states, *driven, *constants)))
        x, u = (_flat(values, shape) for values in (states, driven))
        rates = self._advanced(x, u, self._models_of(constants, shape)).reshape(*shape, -1)
        first = {j.position: getattr(state, j.speed) for j in joints}
        for angles in self._elements.free_angles:
            at, by = ([getattr(state, n) for n in names] for names in zip(
                *((a.position, a.speed) for a in angles), strict=True))  # fmt: skip
            first |= zip((a.position for a in angles), angle_rates(at, by), strict=True)
        later = [*(j.speed for j in joints), *(a.state for a in acting)]
        return first | {name: rates[..., i] for i, name in enumerate(later)}

    def _at_centres(self, state: Point, forces: Mapping[str, Any]) -> dict[str, Any]:
        """Forces as MuJoCo takes them, at the origins of bodies that move freely."""
        result = {j.speed: forces[j.speed] for j in self._elements.joints if j.speed in forces}
        for angles in self._elements.free_angles:
            body = angles[0].body
            slides = [j.speed for j in self._elements.joints if j.body == body and not j.turns]
            if any(name in result for name in slides):
                pushes = [result.get(name, 0.0) for name in slides]
                at = [getattr(state, a.position) for a in angles]
                turns = twist(at, pushes, self._elements.centres[body])
                for axis, turn in zip(angles, turns, strict=True):
                    result[axis.speed] = result.get(axis.speed, 0.0) + turn
        return result

    def geometric(self) -> tuple[str, ...]:
        """The angles of bodies that move freely."""
        return tuple(a.position for angles in self._elements.free_angles for a in angles)

    def start(self, measured: Point) -> Mapping[str, Any]:
        """How a body that moves freely turns along a log, from its angles; see `System.start`."""
        found: dict[str, Any] = {}
        shown = vars(measured)
        for angles in self._elements.free_angles:
            at = [shown[a.position] for a in angles if a.position in shown]
            if len(at) == len(angles) and np.size(at[0]) > 1:
                edges: Literal[1, 2] = 2 if len(at[0]) > 2 else 1
                rates = [np.gradient(v, 1.0 / self.rate_hz, edge_order=edges) for v in at]
                found |= zip((a.speed for a in angles), turning(at, rates), strict=True)
        return {name: row for name, row in found.items() if name not in shown}

    def export(self, answer: "Answer", out: Path) -> list[str]:
        """An answer as a corrected MJCF with ranges, in a folder; sentences about what is there.

        `answer` is the artefact that name.json holds; a `Gap`'s `result` has all of it, too.
        """
        from wakedeploy.gap.systems.mjcf.corrected import write_corrected

        return write_corrected(self._elements, {c.name: c for c in self.constants}, answer, out)

    def log_notes(self, outputs: Mapping[str, FloatArray]) -> list[str]:
        """Which bodies touch each other where logs have been, and where angles are none."""
        from wakedeploy.gap.systems.mjcf.contacts import contact_notes
        from wakedeploy.gap.systems.mjcf.free_bodies import place_notes

        notes = [
            note
            for angles in self._elements.free_angles
            for note in place_notes([j for j in self._elements.joints if j.body == angles[0].body],
                                    outputs)
        ]  # fmt: skip
        return [*notes, *contact_notes(self._elements, outputs)]

    def _advanced(self, x: FloatArray, u: FloatArray, models: list[Any]) -> FloatArray:
        """Rates of speeds and activations (N, v), after those of positions in states (N, n).

        Commands and forces are (N, m); each point has its own of N models.
        """
        model, joints = self._elements.model, len(self._elements.joints)
        if not len(x):
            return np.empty((0, x.shape[1] - joints))
        lost = ~((np.abs(x) < self._farthest).all(1) & (np.abs(u).max(1) < _STRONGEST))
        x, u = np.where(lost[:, None], 0.0, x), np.where(lost[:, None], 0.0, u)
        places = self._elements.positions(x[:, :joints])
        full = np.concatenate([np.zeros((len(x), 1)), places, x[:, joints:]], axis=1)
        spec = self._library.mjtState
        result = np.empty((len(x), 1, full.shape[1]))
        sensed = np.empty((len(x), 1, self._plain.nsensordata))
        pool, data = self._pool(len(x))
        # Its checks ask each model for its sizes at every step, which takes as long as the step.
        pool.rollout(
            models, data, full, np.ascontiguousarray(u[:, None, :]),
            control_spec=int(spec.mjSTATE_CTRL) | int(spec.mjSTATE_QFRC_APPLIED),
            nstep=1, state=result, sensordata=sensed, skip_checks=True,
        )  # fmt: skip
        rates = np.asarray((result[:, 0, 1 + model.nq :] - x[:, joints:]) / _STEP_S)
        rates[lost] = np.nan
        return rates

    def _models_of(self, constants: list[FloatArray], shape: tuple[int, ...]) -> list[Any]:
        """The model for each point of a shape, under constants that broadcast to it."""
        count = int(np.prod(shape, dtype=int))
        if not constants:
            return [self._plain] * count
        asked = shape, tuple((v.shape, v.tobytes()) for v in constants)
        latest, models = self._latest.get(shape, (None, []))
        if asked == latest:  # a filter asks with the same ones at each of its samples
            return models
        if len(self._models) > _MOST_MODELS:
            self._models.clear()
        models, known = [], self._models
        for row in _flat(constants, shape):
            key = row.tobytes()
            model = known.get(key)
            if model is None:
                model = known[key] = self._with(row)
            models.append(model)
        if len(self._latest) >= _MOST_SHAPES:
            self._latest.clear()
        self._latest[shape] = asked, models
        return models

    def _with(self, values: FloatArray) -> Any:
        """A model with other constants."""
        model = _copied(self._plain)
        for name, value in zip(self._names, values, strict=True):
            self._elements.attributes[name].set(model, float(value))
        self._library.mj_setConst(model, self._library.MjData(model))
        return model

    def _pool(self, points: int) -> tuple[Any, Any]:
        """Threads, and a place to compute in for each; one of both for a few points."""
        if self._rollout is None:
            rollout = importlib.import_module("mujoco.rollout")
            threads = os.cpu_count() or 1
            data = [self._library.MjData(self._plain) for _ in range(threads)]
            self._rollout = rollout.Rollout(nthread=0), rollout.Rollout(nthread=threads), data
        alone, many, data = self._rollout
        return (many, data) if points >= _WORTH_THREADS else (alone, data[:1])


def _checked_names(system: MjcfSystem, elements: Elements) -> tuple[str, ...]:
    """The constants that set an attribute; UnusableInput for names that the file does not have."""
    joints, actuators = elements.joints, elements.actuators
    states = [*(j.position for j in joints), *(j.speed for j in joints)]
    states += [a.state for a in actuators if a.act >= 0]
    commands = {a.command for a in actuators}
    # What a command's law is made of is no command of the model.
    made_of = bool(commands & {i.name for i in system.inputs if i.law is not None})
    inputs = [i.name for i in system.inputs if i.name in commands or not made_of]
    wanted = {"states": list(system.states), "inputs": inputs}
    for what, there in (("states", states), ("inputs", [a.command for a in actuators])):
        if sorted(wanted[what]) != sorted(there):
            raise UnusableInput(
                f"{system.name}.{what}: {elements.path} has {', '.join(there)}; state these."
            )
    delays_s = {a.command: a.delay_s for a in actuators}
    for stated in (i for i in system.inputs if i.name in commands):
        same = isinstance(stated.delay_s, int | float) and math.isclose(
            stated.delay_s, delays_s[stated.name], rel_tol=1e-3, abs_tol=1e-6
        )
        if not same:
            raise UnusableInput(
                f"{system.name}: input {stated.name!r} has delay_s={stated.delay_s!r}, and its "
                f"actuator in {elements.path} a delay of {delays_s[stated.name]:g} s; state the "
                "same in both."
            )
    known = {*elements.attributes, *(j.inertia_name for j in joints)}
    for constant in system.constants:
        if constant.name not in known:
            raise UnusableInput(
                f"{system.name}: constant {constant.name!r} is no attribute of {elements.path}; "
                f"there are: {', '.join(elements.attributes)}."
            )
    if rubbing := next((port.name for port in system.ports if port.friction), ""):
        raise UnusableInput(
            f"{system.name}: the port of {rubbing!r} states a friction; MuJoCo's frictionloss acts "
            "already, so leave it out there."
        )
    return tuple(c.name for c in system.constants if c.name in elements.attributes)


def _explicit(library: Any, model: Any) -> Any:
    """A copy that takes one tiny explicit step, each as if it were the first."""
    plain = _copied(model)
    plain.opt.timestep = _STEP_S
    plain.opt.integrator = int(library.mjtIntegrator.mjINT_EULER)
    exact = plain.actuator_dyntype == int(library.mjtDyn.mjDYN_FILTEREXACT)
    plain.actuator_dyntype[exact] = int(library.mjtDyn.mjDYN_FILTER)
    off = library.mjtDisableBit
    for flag in (off.mjDSBL_EULERDAMP, off.mjDSBL_WARMSTART, off.mjDSBL_SENSOR):
        plain.opt.disableflags |= int(flag)
    return plain


def _copied(model: Any) -> Any:
    return model.__copy__()


def _flat(values: Sequence[Any], shape: tuple[int, ...]) -> FloatArray:
    """Values that broadcast to a shape, as rows (N, k)."""
    rows = np.empty((*shape, len(values)))
    for i, value in enumerate(values):
        rows[..., i] = value
    return rows.reshape(-1, len(values))
