"""The effects that a system may lack: every kind at every port where it makes sense.

An effect's name is `kind@port`, as `coulomb-friction@speed_mps`; a coupling says what it comes
from: `coupling-from-voltage_v@speed_mps`.
"""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.names import unknown
from wakedeploy.gap.evidence.fits import Free
from wakedeploy.gap.systems.kinds import forces, inputs, sensors
from wakedeploy.gap.systems.kinds.kind import Kind, Parameter, Scales
from wakedeploy.gap.systems.ports import DIFFERENCE, Port
from wakedeploy.gap.systems.system import StateSpace
from wakedeploy.gap.wording import with_name

_ANGLES = ("rad",)
_CUT = 3  # readings that are all the same, and the last to one side: cut there perhaps
_ROLES_ALIKE = ("input", "force", "between", "output")
_STILL = 0.1  # of the usual size: nearer to 0 a sign may be about to turn
_FORCES = {  # by the unit of what a force is over, and of the rate
    ("kg", "m/s²"): "N",
    ("kg m²", "rad/s²"): "N m",
    ("kg m^2", "rad/s²"): "N m",
    ("J/K", "K/s"): "W",
    ("J/K", "degC/s"): "W",
    ("m²", "m/s"): "m³/s",
    ("m^2", "m/s"): "m³/s",
}
KINDS_BY_ROLE: dict[str, tuple[Kind, ...]] = {
    "input": inputs.KINDS,
    "force": forces.KINDS,
    "between": forces.BETWEEN,
    "output": sensors.OUTPUT_KINDS,
    "constant": sensors.CONSTANT_KINDS,
}


def custom_kind(port: Port) -> Kind:
    """A kind of the user's own, from `Port.custom`."""
    amplitudes = [Parameter(name, {f"own {name}": 1}) for name in port.parameters]
    shapes = [
        Parameter(name, {f"own {name}": 1}, neutral=1.0, low=0.1, high=10.0, prior=1.0,
                  starts=(1.0, 1.0, 0.5, 2.0))
        for name in port.shapes
    ]  # fmt: skip
    parameters = (*amplitudes, *shapes)
    stated = {"name": port.name, "parameters": parameters, "source": "the system's file"}
    stated["equation"] = "as the system's file has it"
    kind: Kind = type("Custom", (Kind,), stated)()
    return kind


@dataclass(frozen=True, eq=False)
class Effect:
    """A kind at a port of a system; `other` is the input or state that a coupling comes from."""

    name: str
    kind: Kind
    port: Port
    scales: Scales
    other: str = ""

    @property
    def free(self) -> tuple[Free, ...]:
        """Its parameters as a fit sees them."""
        return tuple(p.free(self.name, self.scales) for p in self.kind.parameters)

    @functools.cached_property
    def own_states(self) -> tuple[str, ...]:
        """Names of the states that it adds."""
        return tuple(f"{self.name}.state{i}" for i in range(self.kind.own_states))

    def parameters(self, values: Mapping[str, object]) -> dict[str, object]:
        """Its own out of all values, by the names that its kind has for them."""
        return {short: values[name] for short, name in self._parameters}

    @functools.cached_property
    def _parameters(self) -> tuple[tuple[str, str], ...]:
        """The kind's name and the whole name of each."""
        return tuple((p.name, f"{self.name}.{p.name}") for p in self.kind.parameters)


def kinds_of(effect: str) -> list[Kind]:
    """The kinds, one for each role, that an effect's name says; [] for one of the user's own."""
    kind_name = effect.partition("@")[0].partition("-from-")[0]
    return [k for kinds in KINDS_BY_ROLE.values() for k in kinds if k.name == kind_name]


def plain(name: str) -> str:
    """An effect in words before its name: ``dry friction that acts on v (`coulomb-friction@v`)``.

    Of an effect that no kind here makes, as a user's own, the name alone.
    """
    kind_name, _, port = name.partition("@")
    other = kind_name.partition("-from-")[2]
    kinds = kinds_of(name) if port else []
    first, _, second = port.partition(DIFFERENCE)
    if kinds and second:
        return with_name(kinds[-1].between.format(first=first, second=second), name)
    phrase = kinds[-1].phrase if kinds else ""
    return with_name(phrase.format(port=port, other=other), name)


def kind_named(port: Port, name: str) -> Kind:
    """A kind by its name; UnusableInput for one that the port's role does not have."""
    for kind in KINDS_BY_ROLE[port.role]:
        if kind.name == name:
            return kind
    known = [k.name for k in KINDS_BY_ROLE[port.role]]
    what = unknown(name, f"kind of the {port.role} port {port.name!r}", dict.fromkeys(known))
    raise UnusableInput(f"{what}.")


def offered(
    system: StateSpace, sizes: Mapping[str, float], times: tuple[float, float]
) -> dict[str, Effect]:
    """Every effect by name. `sizes` are usual sizes of inputs, states, rates (`d x`) and outputs.

    They may say of an input or a state how near to 0 it comes (`least x`), and whether its sign
    changes (`turns x`, 1 or 0); what they do not say is taken to happen.
    `times` are the time between samples and the length of a log [s].
    """
    found: dict[str, Effect] = {}
    for port in system.ports:
        scales = _scales(system, port, sizes, times)
        for kind in _kinds(system, port, sizes):
            for other in _others(system, port, kind):
                suffix = f"-from-{other}" if other else ""
                name = f"{kind.name}{suffix}@{port.name}"
                if port.role == "custom":
                    name = port.name
                effect = Effect(name, kind, port, _beside(scales, system, sizes, other), other)
                if _is_sized(effect):
                    found[name] = effect
    return found


def _is_sized(effect: Effect) -> bool:
    """Whether its parameters have usual sizes; not where a size over something at rest is asked."""
    sizes = effect.scales.sizes
    powers = [each for p in effect.kind.parameters for each in p.of.items()]
    return all(sizes[k] != 0.0 for k, power in powers if power < 0)


def _kinds(system: StateSpace, port: Port, sizes: Mapping[str, float]) -> tuple[Kind, ...]:
    if port.role == "custom":
        return (custom_kind(port),)
    for name in port.kinds:
        kind_named(port, name)
    return tuple(
        kind
        for kind in KINDS_BY_ROLE[port.role]
        if (not port.kinds or kind.name in port.kinds) and _makes_sense(system, port, kind, sizes)
    )


def not_offered(system: StateSpace, state: str, sizes: Mapping[str, float]) -> list[str]:
    """Kinds of force that make sense on a state, and that its ports leave out by their `kinds`."""
    ports = [p for p in system.ports if p.role == "force" and p.name == state and p.kinds]
    return [
        kind.name
        for port in ports
        for kind in KINDS_BY_ROLE["force"]
        if kind.name not in port.kinds and _makes_sense(system, port, kind, sizes)
    ]


def _makes_sense(system: StateSpace, port: Port, kind: Kind, sizes: Mapping[str, float]) -> bool:
    """Whether the port has what a kind needs, and the logs what makes it differ from another."""
    turns = sizes.get(f"turns {port.name}", 1.0) > 0.0
    near = sizes.get(f"least {port.name}", 0.0) <= _STILL * sizes.get(port.name, 1.0)
    angle = bool(port.position) and system.unit_of_state(port.position) in _ANGLES
    there = {"position": bool(port.position), "height": bool(port.height), "angle": angle}
    moving = _moves(system, port)
    there |= {"level": not moving, "moving": moving}
    there |= {"inertia": bool(port.inertia), "other": True}
    there |= {"turning": turns, "still": turns or near}
    for what, end in (("above", "top"), ("below", "bottom")):
        there[f"cut {what}"] = sizes.get(f"readings at {end} {port.name}", _CUT) >= _CUT
    if port.role == "constant" and kind.name == "scale":  # one that is free already has any size
        return system.constant(port.name).spread != float("inf")
    if isinstance(kind, inputs.InputKind) and kind.passes_laws and _acts_before(system, port, kind):
        return False
    return all(there[need] for need in kind.needs)


def _acts_before(system: StateSpace, port: Port, kind: Kind) -> bool:
    """Whether a kind is offered at the only logged input that a port's own input is made of.

    Where that input also acts beside the law, the same behind the law alone is something else; and
    who names the kind at the port wants it there.
    """
    sources = system.made_of.get(port.name, ())
    if len(sources) != 1 or port.kinds or any(sources[0] in system.uses(s) for s in system.states):
        return False
    return any(
        p.role == "input" and p.name == sources[0] and (not p.kinds or kind.name in p.kinds)
        for p in system.ports
    )


def _moves(system: StateSpace, port: Port) -> bool:
    """Whether a port's state is the speed of its position; of a discrete system, as it is said."""
    if system.has_step:
        return port.position != port.name
    kinematic = system.kinematic()
    if port.role == "between":
        return tuple(kinematic.get(p) for p in port.positions) == port.speeds
    return kinematic.get(port.position) == port.name


def _others(system: StateSpace, port: Port, kind: Kind) -> tuple[str, ...]:
    """What a coupling may come from: inputs and other axes that do not drive this state yet."""
    if "other" not in kind.needs:
        return ("",)
    axes = [p for p in system.ports if p.role == "force" and p.name != port.name]
    states = [n for p in axes for n in (p.position, p.name) if n]
    names = [*(i.name for i in system.inputs), *states]
    return tuple(n for n in dict.fromkeys(names) if n not in system.drivers(port.name))


def _scales(
    system: StateSpace, port: Port, sizes: Mapping[str, float], times: tuple[float, float]
) -> Scales:
    dt_s, span_s = times
    there = {"time": dt_s, "span": span_s}
    units = {"time": "s", "span": "s"}
    if port.role == "input":
        there["input"] = sizes[port.name]
        there["largest"] = sizes.get(f"largest {port.name}", sizes[port.name])
        units["input"] = next(i.unit for i in system.inputs if i.name == port.name)
    elif port.role == "output":
        there["output"] = sizes[f"y {port.name}"]
        there["top"] = sizes.get(f"top {port.name}", sizes[f"y {port.name}"])
        there["bottom"] = sizes.get(f"bottom {port.name}", -sizes[f"y {port.name}"])
        units["output"] = next(o.unit for o in system.outputs if o.name == port.name)
    elif port.role in ("force", "between"):
        there |= {"force": _usual_force(system, port, sizes), "speed": sizes[port.name]}
        units |= {"force": force_unit(system, port), "speed": system.unit_of_state(port.name)}
        for part, name in (("position", port.position), ("height", port.height)):
            if name:
                there[part], units[part] = sizes[name], system.unit_of_state(name)
        if port.position:
            there |= _way(port.position, sizes)
            units |= dict.fromkeys(("lowest", "highest", "range"), units["position"])
        if "position" not in there:
            there["position"] = there["speed"] * 10.0 * dt_s
            units["position"] = f"{units['speed']} s"
    for name, (unit, size) in (*port.parameters.items(), *port.shapes.items()):
        there[f"own {name}"], units[f"own {name}"] = size, unit
    return Scales(there, units)


def _usual_force(system: StateSpace, port: Port, sizes: Mapping[str, float]) -> float:
    """What usually moves a port's state, in the unit of forces there.

    Of two bodies it is the one that less moves: more than that does not pass between them.
    """
    if port.role == "between":
        inertias = [abs(system.constant(n).value) for n in port.inertias] or [1.0, 1.0]
        usual = [i * sizes[f"d {n}"] for i, n in zip(inertias, port.speeds, strict=True)]
        return min(usual[0] * abs(port.ratio), usual[1])
    if port.inertia:
        return abs(system.constant(port.inertia).value) * sizes[f"d {port.name}"]
    return sizes[port.acts_like] if port.like else sizes[f"d {port.name}"]


def _way(position: str, sizes: Mapping[str, float]) -> dict[str, float]:
    """How far a position goes; of one that no log shows, its usual size on either side."""
    lowest = sizes.get(f"lowest {position}", -sizes[position])
    highest = sizes.get(f"highest {position}", sizes[position])
    return {"lowest": lowest, "highest": highest, "range": highest - lowest}


def _beside(scales: Scales, system: StateSpace, sizes: Mapping[str, float], other: str) -> Scales:
    if not other:
        return scales
    units = {i.name: i.unit for i in system.inputs} | dict(system.states)
    return Scales({**scales.sizes, "other": sizes[other]}, {**scales.units, "other": units[other]})


def force_unit(system: StateSpace, port: Port) -> str:
    """The unit of a force at the port, from its input's, or its inertia's and its speed's."""
    if port.unit:
        return port.unit
    if port.like:
        return next(i.unit for i in system.inputs if i.name == port.acts_like)
    rate = rate_unit(system.unit_of_state(port.name))
    over = port.inertia or (port.inertias[1] if port.inertias else "")
    if not over:
        return rate
    inertia = system.unit_of_constant(over)
    return _FORCES.get((inertia, rate), f"{inertia} {rate}")


def rate_unit(unit: str) -> str:
    """The unit of a rate, from that of its state: m/s² of m/s."""
    return {"m/s": "m/s²", "rad/s": "rad/s²"}.get(unit, f"{unit}/s")


def held_by(system: StateSpace, library: Mapping[str, Effect], acting: Sequence[str]) -> list[str]:
    """Constant effects on the axis of a dry friction that acts: one that small it holds."""
    axes = [library[name].port for name in acting if library[name].kind.is_dry]
    return [
        name
        for name, effect in library.items()
        if effect.kind.is_constant and any(_is_on(system, effect.port, axis) for axis in axes)
    ]


def _is_on(system: StateSpace, port: Port, axis: Port) -> bool:
    """Whether a port is that of a force on the axis, of its only driver, or of its sensor."""
    if axis.role == "between":
        return port.name == axis.name
    if port.role == "output":
        return bool(axis.position) and system.shown_states().get(port.name) == axis.position
    drivers = (
        {axis.acts_like}
        if axis.like
        else system.drivers(axis.name) & {i.name for i in system.logged}
    )
    return port.name == axis.name or (port.role == "input" and drivers == {port.name})


def ports_alike(library: Mapping[str, Effect], name: str) -> list[str]:
    """Effects of the same kind at other inputs, forces or outputs of the same unit."""
    mine = library[name]
    if mine.port.role not in _ROLES_ALIKE:
        return []
    return [n for n, e in library.items() if n != name and _at(e) == _at(mine)]


def _at(effect: Effect) -> tuple[str, str, str, str]:
    """Kind, what it comes from, role of the port, and the unit of what goes through it."""
    role = effect.port.role
    return effect.kind.name, effect.other, role, effect.scales.units.get(role, "")
