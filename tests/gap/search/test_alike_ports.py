"""What ports lack alike: a robot on two wheels, integrated here, whose sides are the same."""

from typing import ClassVar

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import Candidate
from wakedeploy.gap.search import alike_ports
from wakedeploy.gap.search.alike_ports import askable, distinct, room_for, twins
from wakedeploy.gap.search.imitation import doing_alike
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.outcome import verdict_of
from wakedeploy.gap.search.rivalry import Verdict
from wakedeploy.gap.systems.likelihood.logs import LogModel

RATE, FINE = 20.0, 50
MASS_KG, INERTIA, HALF_M, PUSH_NPV, BACK = 6.0, 0.12, 0.16, 1.8, 9.0
FRICTION_N, SAG_PER_S = 1.5, -0.012


class Rover(System):
    """Two motors push; a force at a wheel moves the robot and turns it."""

    rate_hz = RATE
    inputs: ClassVar = [Input("left_v", "V"), Input("right_v", "V")]
    states: ClassVar = {"left_mps": "m/s", "right_mps": "m/s"}
    outputs: ClassVar = [
        Output("left_mps", "m/s", noise=5e-3),
        Output("right_mps", "m/s", noise=5e-3),
    ]
    constants: ClassVar = [
        Constant("mass_kg", 6.1, spread=0.1),
        Constant("inertia", 0.115, spread=0.01, unit="kg m^2"),
        Constant("push_n_per_v", 1.75, spread=0.1),
        Constant("back", 8.8, spread=0.5, unit="N/(m/s)"),
    ]
    ports: ClassVar = [
        Port.input("left_v", kinds=["drift", "gain"]),
        Port.input("right_v", kinds=["drift", "gain"]),
        Port.force("left_mps", inertia="mass_kg", kinds=["coulomb-friction", "stribeck-friction"]),
        Port.force("right_mps", inertia="mass_kg", kinds=["coulomb-friction", "stribeck-friction"]),
    ]

    def derivative(self, state, inputs, c):
        return self.derivative_under(state, inputs, c, {})

    def derivative_under(self, state, inputs, c, forces):
        left, right = (
            c.push_n_per_v * volts - c.back * speed + forces.get(name, 0.0)
            for name, volts, speed in (
                ("left_mps", inputs.left_v, state.left_mps),
                ("right_mps", inputs.right_v, state.right_mps),
            )
        )
        forward, turn = (left + right) / c.mass_kg, HALF_M**2 * (right - left) / c.inertia
        return {"left_mps": forward - turn, "right_mps": forward + turn}


def _driven(
    seed: int, friction_n: float = 0.0, sag_per_s: float = 0.0, lag_s: float = 0.0
) -> Recording:
    """Random steps of both motors, in small steps of Euler's method."""
    rng = np.random.default_rng(seed)
    n = 400
    volts = np.repeat(rng.uniform(-6.0, 6.0, (n // 20, 2)), 20, axis=0)
    speeds, shown, dt = np.zeros(2), np.empty((n, 2)), 1.0 / RATE / FINE
    acting = np.zeros(2)
    for k in range(n):
        shown[k] = speeds
        for i in range(FINE):
            sag = 1.0 + sag_per_s * (k / RATE + i * dt)
            acting = acting + dt / lag_s * (volts[k] - acting) if lag_s else volts[k]
            pushes = PUSH_NPV * sag * acting - BACK * speeds
            pushes -= friction_n * np.tanh(speeds / 2e-3)
            forward, turn = pushes.sum() / MASS_KG, HALF_M**2 * (pushes[1] - pushes[0]) / INERTIA
            speeds = speeds + dt * np.array([forward - turn, forward + turn])
    shown += 5e-3 * rng.standard_normal((n, 2))
    columns = {"left_v": volts[:, 0], "right_v": volts[:, 1]}
    columns |= {"left_mps": shown[:, 0], "right_mps": shown[:, 1]}
    return Recording(f"drive {seed}", np.arange(n) / RATE, columns)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "names", "size", "truth"),
    [
        (
            {"friction_n": FRICTION_N},
            {"coulomb-friction@left_mps", "coulomb-friction@right_mps"},
            "force",
            FRICTION_N,
        ),
        ({"sag_per_s": SAG_PER_S}, {"drift@left_v", "drift@right_v"}, "rate", SAG_PER_S),
    ],
)
def test_what_both_sides_lack_is_named_at_both(hidden, names, size, truth):
    """Given to one side it turns the robot: that side's was turned down, or took another shape."""
    model = LogModel(Rover(), [_driven(seed, **hidden) for seed in (1, 2)])
    naming = named(model, fitted_base(model))
    assert verdict_of(naming) == "named"
    assert set(naming.found.hypothesis) == names
    for name in names:
        low, high = naming.found.interval(f"{name}.{size}")
        assert low < truth < high or naming.found.value(f"{name}.{size}") == pytest.approx(
            truth, rel=0.05
        )


def test_a_kind_at_several_ports_counts_once_towards_the_most_that_are_named():
    model = LogModel(Rover(), [_driven(1)])
    drifts, gains = (
        tuple(f"{kind}@{port}" for port in ("left_v", "right_v")) for kind in ("drift", "gain")
    )
    frictions = ("coulomb-friction@left_mps", "coulomb-friction@right_mps")
    assert distinct(model, (*drifts, *gains)) == 2
    assert room_for(model, (*drifts, *gains)) == 4
    assert room_for(model, (*drifts, *gains), 2) == 4
    assert room_for(model, (*drifts, *gains, *frictions), 2) == 0
    assert room_for(model, (*drifts, *gains, *frictions)) == 2
    full = (*drifts, *gains, *frictions, "stribeck-friction@left_mps")
    assert room_for(model, full) == 1  # for the other wheel's
    twin, other = "stribeck-friction@right_mps", "sensor-lag@left_mps"
    assert askable(model, full, [twin]) == [twin]
    assert room_for(model, (*full, twin)) == 0
    assert askable(model, full[:1], [twin, full[2]]) == [twin, full[2]]
    fourth = (drifts[0], gains[0], frictions[0], full[-1])
    assert askable(model, fourth, [drifts[1], twin]) == [drifts[1], twin]
    assert other not in model.library


@pytest.fixture(scope="module")
def slow_motors():
    """A rover whose motors lag, as it is, and fits of each effect at one of them."""

    class Slow(Rover):
        ports: ClassVar = [
            *(Port.input(n, kinds=["lag", "sample-and-hold"]) for n in ("left_v", "right_v")),
            *Rover.ports[2:],
        ]

    model = LogModel(Slow(), [_driven(seed, lag_s=0.08) for seed in (1, 2)])
    base, fits = fitted_base(model), {}
    for name in ("sample-and-hold@right_v", "sample-and-hold@left_v", "lag@right_v", "lag@left_v"):
        start = [0.08 if f.name.startswith(name) else f.neutral for f in model.free((name,))]
        fits[name] = fit(model, (name,), base.episodes, np.array(start))
    return model, base, fits


@pytest.mark.parametrize(
    "gaining", [{"sample-and-hold@right_v", "sample-and-hold@left_v"}, {"lag@right_v"}]
)
def test_kinds_are_asked_at_ports_alike_that_gain_nothing_at_one_alone(
    slow_motors, gaining, monkeypatch
):
    """A lag of one motor turns the robot; a hold gains at either motor, or another effect does."""
    model, base, fits = slow_motors
    verdicts = []
    for name, fitted in fits.items():
        gains = np.full(len(base.episodes), 1.0 if name in gaining else 0.0)
        verdicts.append(Verdict(Candidate(name, fitted, gains), ""))
    verdicts.sort(key=lambda v: -v.candidate.gain_nats)
    needed = {v.candidate.name: 5.0 for v in verdicts}
    leads = []
    monkeypatch.setattr(
        alike_ports,
        "doing_alike",
        lambda model, found, lead, sets: (
            leads.append(lead) or doing_alike(model, found, lead, sets)
        ),
    )
    best = twins(model, base, verdicts, needed, most=4)[0]
    assert best.names == ("lag@right_v", "lag@left_v")  # the one that gains most is the first
    assert best.first.candidate.name == "lag@right_v"
    assert [len(lead.hypothesis) for lead in leads] == [len(gaining)]
    for name in best.names:
        assert best.candidate.fit.value(f"{name}.tau_s") == pytest.approx(0.08, abs=0.01)
    assert not twins(model, base, verdicts, dict.fromkeys(needed, 1e3), most=4)
    without = [v for v in verdicts if v.candidate.name != "lag@left_v"]  # withdrawn there
    assert all(
        "lag" not in name for t in twins(model, base, without, needed, 4) for name in t.names
    )


@pytest.mark.slow
def test_one_constant_that_explains_both_sides_is_named_alone():
    """A kind at both motors gains as much, and takes two sizes for it."""

    class Weak(Rover):
        constants: ClassVar = [
            Constant("mass_kg", MASS_KG),
            Constant("inertia", INERTIA, unit="kg m^2"),
            Constant("push_n_per_v", 1.6),
            Constant("back", BACK, unit="N/(m/s)"),
        ]
        ports: ClassVar = [*Rover.ports, Port.constant("push_n_per_v", kinds=["scale"])]

    model = LogModel(Weak(), [_driven(seed) for seed in (1, 2)])
    naming = named(model, fitted_base(model))
    assert naming.found.hypothesis == ("scale@push_n_per_v",)


def test_ports_are_alike_that_take_the_same_unit():
    model = LogModel(Rover(), [_driven(1)])
    assert model.ports_alike("drift@left_v") == ["drift@right_v"]
    assert model.ports_alike("coulomb-friction@left_mps") == ["coulomb-friction@right_mps"]
    wind = [Input("left_v", "V"), Input("right_v", "m/s")]
    assert not LogModel(type("Windy", (Rover,), {"inputs": wind})(), [_driven(1)]).ports_alike(
        "drift@left_v"
    )


@pytest.mark.slow
def test_what_one_side_lacks_is_named_at_that_side():
    class Lame(Rover):
        pass

    log = [_driven(seed) for seed in (1, 2)]
    for each in log:
        each.columns["left_v"][:] *= 1.15  # as commanded; the left motor has less of it
    model = LogModel(Lame(), log)
    naming = named(model, fitted_base(model))
    assert naming.found.hypothesis == ("gain@left_v",)
    assert naming.found.value("gain@left_v.error") == pytest.approx(1 / 1.15 - 1, abs=0.02)
