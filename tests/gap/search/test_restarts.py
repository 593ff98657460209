"""Candidates begun anew: constants that nobody measured have bent to what a system lacks."""

from dataclasses import replace
from typing import ClassVar

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap import workflow
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.search.comparison import errors
from wakedeploy.gap.search.judging import fitted_base
from wakedeploy.gap.search.outcome import Named
from wakedeploy.gap.search.restarts import begun_anew
from wakedeploy.gap.search.scan import ranked
from wakedeploy.gap.systems.answers import folder
from wakedeploy.gap.systems.answers.folder import OwnFolder
from wakedeploy.gap.systems.likelihood.logs import LogModel

RATE = 50.0
INF = float("inf")
LAG = "lag@drive_v"


class Belt(System):
    """A belt over a sprung pulley; its sensor cannot tell the direction."""

    rate_hz = RATE
    inputs: ClassVar = [Input("drive_v", "V")]
    states: ClassVar = {"speed_v": "V", "slope_v_per_s": "V/s"}
    outputs: ClassVar = [Output("reading_v", "V", noise=0.03)]
    constants: ClassVar = [
        Constant("stiffness", 60.0, spread=INF),
        Constant("damping", 5.0, spread=INF),
        Constant("gain", 2.0, spread=INF),
    ]
    ports: ClassVar = [
        Port.input("drive_v", kinds=["lag", "gain"]),
        Port.output("reading_v", kinds=["sensor-bias"]),
    ]

    def start(self, measured):
        return {"speed_v": measured.reading_v}

    def derivative(self, state, inputs, c):
        pull = c.gain * inputs.drive_v - state.speed_v
        slope = c.stiffness * pull - c.damping * state.slope_v_per_s
        return {"speed_v": state.slope_v_per_s, "slope_v_per_s": slope}

    def measure(self, state, inputs, c):
        return {"reading_v": np.abs(state.speed_v)}


def driven(seconds=10.0, lag_s=0.16):
    """A belt of other constants behind a motor that lags, in fine steps."""
    rng = np.random.default_rng(5)
    n, fine = int(seconds * RATE), 20
    held = np.repeat(rng.choice((-1.0, 1.0), n // 10 + 1), 10)[:n]
    speed = slope = motor = 0.0
    shown, step_s = np.empty(n), 1.0 / RATE / fine
    for k in range(n):
        shown[k] = abs(speed) + 0.03 * rng.standard_normal()
        push = 20.0 * rng.standard_normal()
        for _ in range(fine):
            motor += (held[k] - motor) / lag_s * step_s
            slope += (420.0 * (2.0 * motor - speed) - 4.5 * slope + push) * step_s
            speed += slope * step_s
    return Recording("belt", np.arange(n) / RATE, {"drive_v": held, "reading_v": shown})


@pytest.mark.slow
def test_an_effect_is_found_whose_lack_has_bent_the_constants():
    model = LogModel(Belt(), [driven()])
    base = fitted_base(model)
    from_base = {c.name: c.gain_nats for c in ranked(model, base, list(model.effects))[0]}
    anew = begun_anew(model, base, list(model.effects))
    assert anew[LAG].objective - base.objective > from_base[LAG] + 50.0
    assert anew[LAG].value(f"{LAG}.tau_s") == pytest.approx(0.16, abs=0.03)
    first = ranked(model, base, list(model.effects), known=anew)[0][0]
    assert first.name == LAG


def test_constants_that_were_measured_need_no_second_beginning():
    class Known(Belt):
        constants: ClassVar = [
            Constant("stiffness", 420.0, 10.0),
            Constant("damping", 4.5, 0.2),
            Constant("gain", 2.0, 0.05),
        ]

    model = LogModel(Known(), [driven(4.0)])
    assert begun_anew(model, fitted_base(model), list(model.effects)) == {}


@pytest.mark.slow
def test_the_gap_before_is_that_of_the_base_from_which_effects_were_found(tmp_path, monkeypatch):
    """`find` fitted a worse one; what that had left to rise is no effect's merit."""
    model = LogModel(Belt(), [driven(4.0)])

    def better(model, base, progress):
        moved = np.array([0.1 if f.name == "constant.gain" else 0.0 for f in base.free])
        found.append(fit(model, (), base.episodes, base.theta + moved))
        found[-1] = replace(found[-1], theta=base.theta + moved)
        return Named(model, found[-1], found[-1], [])

    found: list = []
    monkeypatch.setattr(workflow, "named", better)
    shown = OwnFolder(model, tmp_path).show()
    before = errors(model, found[-1], model.sealed())
    assert shown.gap["reading_v"].before == pytest.approx(before[0], rel=1e-6)
    assert before[0] != pytest.approx(errors(model, fitted_base(model), model.sealed())[0])


def test_what_was_found_for_another_port_is_found_again(tmp_path):
    """Effects at a state's rate, as forces of its inertia, and where the model has friction."""
    log = driven(4.0)
    at_slope = (
        [Port.force("slope_v_per_s")],
        [Port.force("slope_v_per_s", inertia="stiffness")],
        [Port.force("slope_v_per_s", inertia="stiffness", friction="damping")],
    )
    keys = set()
    for ports in at_slope:
        system = type("Belt", (Belt,), {"ports": [*Belt.ports, *ports]})()
        model = LogModel(system, [log])
        keys |= {OwnFolder(model, tmp_path).key, OwnFolder(model, tmp_path).key}
    assert len(keys) == len(at_slope)


def test_what_was_found_with_other_bounds_or_priors_is_found_again(tmp_path):
    """As another version of the library has them, under the same names."""
    model = LogModel(Belt(), [driven(4.0)])
    (lag,) = model.effects[LAG]
    before = OwnFolder(model, tmp_path).key
    model.effects = {**model.effects, LAG: (replace(lag, prior_sd=2.0 * lag.prior_sd),)}
    assert OwnFolder(model, tmp_path).key != before


def test_what_another_version_of_the_program_found_is_found_again(tmp_path, monkeypatch):
    model = LogModel(Belt(), [driven(4.0)])
    before = OwnFolder(model, tmp_path).key
    monkeypatch.setattr(folder, "VERSION", "0.0.0")
    assert OwnFolder(model, tmp_path).key != before


def test_what_was_found_for_another_system_is_found_again(tmp_path):
    """Whatever a user changes in the file: statements, functions, an effect of the user's own."""
    log = driven(4.0)

    def own(sign, size, width):
        def acting(t, state, inputs, p):
            near = np.exp(-((state.speed_v / p.width) ** 2))
            return {"slope_v_per_s": sign * p.strength * near}

        return [
            *Belt.ports,
            Port.custom("own", acting, {"strength": ("V/s/s", size)}, {"width": ("V", width)}),
        ]

    def shifted(self, state, inputs, c):
        return {"reading_v": np.abs(state.speed_v - 0.01)}

    changes = (
        {}, {"ports": own(1.0, 2.0, 1.0)}, {"ports": own(-1.0, 2.0, 1.0)},
        {"ports": own(1.0, 3.0, 1.0)}, {"ports": own(1.0, 2.0, 0.5)}, {"measure": shifted},
        {"forecast_s": 0.3}, {"outlier_share": 0.01}, {"start_spread": {"slope_v_per_s": 3.0}},
        {"process_noise": {"slope_v_per_s": 5.0}}, {"start": lambda self, measured: {}},
    )  # fmt: skip
    keys = [
        OwnFolder(LogModel(type("Belt", (Belt,), change)(), [log]), tmp_path).key
        for change in changes
    ]
    assert len(set(keys)) == len(changes)
