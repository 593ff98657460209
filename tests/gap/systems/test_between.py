"""A force between two bodies, against equations that are integrated apart from the library."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from wakedeploy import Constant, Input, Output, Port, System, UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.correction import VERSION, Correction, Document, Named
from wakedeploy.gap.systems.kinds.forces import BETWEEN
from wakedeploy.gap.systems.kinds.library import plain
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.simulation import simulated

MOTOR_KGM2, LINK_KGM2, STIFF, DAMP, BEARING = 0.02, 0.05, 30.0, 0.06, 0.1
RATE_HZ = 100.0
GEAR = ("motor_radps", "link_radps")
AT = "motor_radps-link_radps"


class Joint(System):
    """A motor that turns a link by a spring."""

    rate_hz = RATE_HZ
    steps = 4
    inputs = [Input("torque_nm", "N m")]
    states = {"motor_rad": "rad", "motor_radps": "rad/s", "link_rad": "rad", "link_radps": "rad/s"}
    outputs = [Output("motor_rad", "rad", noise=5e-4), Output("link_rad", "rad", noise=5e-4)]
    constants = [
        Constant("motor_kgm2", MOTOR_KGM2, spread=0.001),
        Constant("link_kgm2", LINK_KGM2, spread=0.003),
        Constant("stiff_nm_per_rad", STIFF, spread=1.0),
    ]
    ports = [
        Port.force("motor_radps", inertia="motor_kgm2", position="motor_rad"),
        Port.force("link_radps", inertia="link_kgm2", position="link_rad"),
        Port.between(
            GEAR, inertias=("motor_kgm2", "link_kgm2"), positions=("motor_rad", "link_rad")
        ),
    ]

    def derivative(self, s, u, c):
        turned = c.stiff_nm_per_rad * (s.motor_rad - s.link_rad)
        turned = turned + DAMP * (s.motor_radps - s.link_radps)
        pull = u.torque_nm - turned - BEARING * s.motor_radps
        return {
            "motor_rad": s.motor_radps,
            "motor_radps": pull / c.motor_kgm2,
            "link_rad": s.link_radps,
            "link_radps": (turned - 0.05 * s.link_radps) / c.link_kgm2,
        }


class Free(Joint):
    """The same, which says itself where forces act."""

    def derivative(self, s, u, c):
        return self.derivative_under(s, u, c, dict.fromkeys(GEAR, 0.0))

    def derivative_under(self, s, u, c, forces):
        rates = dict(Joint.derivative(self, s, u, c))
        rates["motor_radps"] = rates["motor_radps"] + forces["motor_radps"] / c.motor_kgm2
        rates["link_radps"] = rates["link_radps"] + forces["link_radps"] / c.link_kgm2
        return rates


def driven(seconds: float, seed: int, play_rad: float = 0.0, noise: float = 0.0) -> Recording:
    """What a joint with play does, integrated by another program's method."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    waves = zip(rng.uniform(0.2, 3.0, 6), rng.uniform(0.0, 6.3, 6), strict=True)
    torque = 0.6 * sum(np.sin(2.0 * np.pi * f * time_s + phase) for f, phase in waves)
    torque *= np.clip(2.0 * (time_s - 0.5), 0.0, 1.0)  # at rest first, so that the start is known

    def rates(_, x, push):
        motor_rad, motor, link_rad, link = x
        bent = motor_rad - link_rad
        bent -= np.clip(bent, -play_rad, play_rad)
        turned = STIFF * bent + DAMP * (motor - link)
        pull = push - turned - BEARING * motor
        return [motor, pull / MOTOR_KGM2, link, (turned - 0.05 * link) / LINK_KGM2]

    x, rows = np.zeros(4), []
    for push in torque:
        rows.append(x)
        x = solve_ivp(
            rates, (0.0, 1.0 / RATE_HZ), x, args=(push,), rtol=1e-8, atol=1e-10, max_step=1e-3
        ).y[:, -1]
    motor, link = np.array(rows)[:, [0, 2]].T + noise * rng.standard_normal((2, len(rows)))
    columns = {"torque_nm": torque, "motor_rad": motor, "link_rad": link}
    return Recording(f"log {seed}", time_s, columns)


def corrected(system: System, log: Recording, name: str, **parameters: float) -> System:
    """A system in which an effect acts."""
    model = LogModel(checked(system), [log])
    units = {f.name.rpartition(".")[2]: f.unit for f in model.effects[name]}
    system.correction = Correction(
        Document(
            version=VERSION, system=system.name, sample_s=1.0 / RATE_HZ, span_s=10.0,
            sizes={k: v for k, v in model.sizes.items() if v >= 0.0 or k.startswith("lowest ")},
            effect=(Named(name=name, parameters=parameters, units=units),),
        )
    )  # fmt: skip
    return system


@pytest.mark.parametrize("kind", [Joint, Free])
def test_free_play_is_a_spring_with_a_dead_zone(kind) -> None:
    log = driven(6.0, 1, play_rad=0.02)
    plain_rad = simulated(kind(), log)["link_rad"]
    system = corrected(kind(), log, f"free-play@{AT}", stiffness=STIFF, width=0.02)
    found_rad = simulated(system, log)["link_rad"]
    truth_rad = log.columns["link_rad"]
    assert np.std(plain_rad - truth_rad) > 20.0 * np.std(found_rad - truth_rad)
    assert found_rad == pytest.approx(truth_rad, abs=5e-4)


@settings(max_examples=25, deadline=None)
@given(
    ratio=st.floats(-50.0, 50.0).filter(lambda r: abs(r) > 0.02),
    size=st.floats(-3.0, 3.0),
    state=st.lists(st.floats(-2.0, 2.0), min_size=4, max_size=4),
    kind=st.sampled_from(["viscous-friction", "stiffness", "cubic-stiffness"]),
)
def test_what_one_body_gains_the_other_loses(ratio, size, state, kind) -> None:
    """Power at both sides is the force times the difference of speeds, whatever the ratio."""

    class Geared(Joint):
        ports = [replace(port, ratio=ratio) if port.speeds else port for port in Joint.ports]

    model = _model(Geared)
    name = f"{kind}@{AT}"
    (parameter,) = model.effects[name]
    values = {f.name: np.array([[f.neutral]]) for f in model.free(())}
    values[parameter.name] = np.array([[size]])
    x = np.array(state).reshape(4, 1, 1)
    inputs = {"torque_nm": np.zeros((1, 1))}
    rates = []
    for hypothesis in ((), (name,)):
        acting = model.acting(hypothesis)
        c = acting.constants(values, np.zeros(1))
        rates.append(acting.rates(x, inputs, c, values, np.zeros(1))[:, 0, 0])
    motor, link = (rates[1] - rates[0])[[1, 3]] * (MOTOR_KGM2, LINK_KGM2)
    ahead, faster = state[0] / ratio - state[2], state[1] / ratio - state[3]
    over = {"viscous-friction": faster, "stiffness": ahead, "cubic-stiffness": ahead**3}[kind]
    force = -size * over
    assert motor == pytest.approx(force / ratio, rel=1e-6, abs=1e-6)
    assert link == pytest.approx(-force, rel=1e-6, abs=1e-6)


_MODELS: dict[str, LogModel] = {}


def _model(kind: type[System]) -> LogModel:
    """The model on one log; only the ports' ratio differs."""
    log = _MODELS.setdefault("log", driven(2.0, 3))  # type: ignore[arg-type]
    return LogModel(checked(kind()), [log])  # type: ignore[list-item]


def test_sizes_and_units_are_those_of_the_second_body() -> None:
    log = driven(2.0, 3)
    model = LogModel(checked(Joint()), [log])
    bent = log.columns["motor_rad"] - log.columns["link_rad"]
    assert model.sizes["motor_rad-link_rad"] == pytest.approx(
        np.quantile(np.abs(bent), 0.98), rel=0.01
    )
    units = {f.name: f.unit for f in model.effects[f"free-play@{AT}"]}
    assert units == {f"free-play@{AT}.stiffness": "N m/rad", f"free-play@{AT}.width": "rad"}
    dry = [n for n in model.effects if n.endswith(f"@{AT}") and n.startswith("coulomb")]
    assert not dry


def test_heat_between_two_rooms_is_in_watts() -> None:
    class Rooms(System):
        rate_hz = 1.0
        inputs = [Input("heat_w", "W")]
        states = {"left_c": "degC", "right_c": "degC"}
        outputs = [Output("left_c", "degC"), Output("right_c", "degC")]
        constants = [
            Constant("left_jpk", 400.0, unit="J/K"),
            Constant("right_jpk", 150.0, unit="J/K"),
        ]
        ports = [Port.between(("left_c", "right_c"), inertias=("left_jpk", "right_jpk"))]

        def derivative(self, s, u, c):
            return {"left_c": u.heat_w / c.left_jpk, "right_c": 0.0 * s.right_c}

    rng = np.random.default_rng(1)
    rows = {n: np.cumsum(rng.standard_normal(60)) for n in ("heat_w", "left_c", "right_c")}
    model = LogModel(checked(Rooms()), [Recording("log", np.arange(60.0), rows)])
    (leak,) = model.effects["viscous-friction@left_c-right_c"]
    assert leak.unit == "W/degC"


def test_it_is_told_in_words() -> None:
    said = plain(f"free-play@{AT}")
    assert said.startswith("play between motor_radps and link_radps, a spring that bears less")
    for kind in BETWEEN:
        said = plain(f"{kind.name}@{AT}")
        assert "motor_radps and link_radps" in said
        assert AT not in said.partition("(")[0]


REFUSED: Mapping[str, tuple[dict[str, object], str]] = {
    "one state": ({"speeds": "motor_radps"}, "those of both bodies"),
    "three": ({"speeds": ("a", "b", "c")}, "those of both bodies"),
    "unknown": ({"speeds": ("motor_radps", "arm_radps")}, "'arm_radps', which is not there"),
    "itself": ({"speeds": ("link_radps", "link_radps")}, "use Port.force"),
    "numbers": ({"speeds": (1, 2)}, "those of both bodies"),
    "one inertia": ({"speeds": GEAR, "inertias": "motor_kgm2"}, 'inertias=."motor_kgm2", "link'),
    "no kinds": ({"speeds": GEAR, "kinds": 3}, "give names"),
    "one place": ({"speeds": GEAR, "positions": ("link_rad", "link_rad")}, "one position for both"),
    "other order": ({"speeds": GEAR, "positions": ("link_rad", "motor_rad")}, "in the order of"),
    "backward": ({"speeds": ("motor_rad", "link_radps"), "ratio": -1.0}, "compares rad with rad/s"),
    "no inertia": ({"speeds": GEAR, "inertias": ("motor_kgm2", "arm_kgm2")}, "'arm_kgm2'"),
    "no ratio": ({"speeds": GEAR, "ratio": 0.0}, "give a number but 0"),
    "units": ({"speeds": ("motor_rad", "link_radps")}, "the ratio of the transmission"),
    "no positions": ({"speeds": GEAR, "kinds": "free-play"}, "give the positions, too"),
    "no unit": ({"speeds": GEAR, "unit": "furlong"}, "'furlong', which is not known"),
    "kind": ({"speeds": GEAR, "kinds": "coulomb-friction"}, "pre-sliding-friction"),
}  # fmt: skip


def _with(**stated: object) -> System:
    """The joint with another port between its bodies."""
    return type("Wrong", (Joint,), {"ports": [Port.between(**stated)]})()


@pytest.mark.parametrize(("stated", "said"), REFUSED.values(), ids=REFUSED)
def test_what_does_not_fit_is_refused(stated, said) -> None:
    log = driven(1.0, 3)
    with pytest.raises(UnusableInput, match=said):
        LogModel(checked(_with(**stated)), [log])


@pytest.mark.parametrize("pair", [GEAR, GEAR[::-1]])
def test_one_pair_has_one_port(pair) -> None:
    both = [Port.between(GEAR), Port.between(pair, ratio=-1.0)]
    with pytest.raises(UnusableInput, match="is there twice"):
        checked(type("Wrong", (Joint,), {"ports": both})())


def test_coupled_masses_need_their_own_function() -> None:
    both = [Port.force("motor_radps", like="torque_nm"), Port.between(GEAR)]
    with pytest.raises(UnusableInput, match="write derivative_under"):
        checked(type("Wrong", (Joint,), {"ports": both})())


def test_a_ratio_may_be_numpys() -> None:
    checked(type("Geared", (Joint,), {"ports": [Port.between(GEAR, ratio=np.int64(50))]})())


@pytest.mark.slow
def test_play_between_motor_and_link_is_named() -> None:
    """Without such a port the answer was a class of four, none of them play."""
    logs = [driven(10.0, seed, play_rad=0.02, noise=5e-4) for seed in (1, 2)]
    model = LogModel(checked(Joint()), logs)
    found = named(model, fitted_base(model)).found
    assert found.hypothesis == (f"free-play@{AT}",)
    low, high = found.interval(f"free-play@{AT}.width")
    assert low < 0.02 < high
    assert high - low < 0.005


@pytest.mark.slow
def test_nothing_is_named_between_bodies_where_nothing_is_missing() -> None:
    logs = [driven(10.0, seed, noise=5e-4) for seed in (1, 2)]
    model = LogModel(checked(Joint()), logs)
    assert named(model, fitted_base(model)).found.hypothesis == ()
