"""Constants that nobody has measured bend to what is missing, and hide it from every look."""

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.first_look import Ground, looks
from wakedeploy.gap.search.judging import fitted_base
from wakedeploy.gap.search.scan import ranked
from wakedeploy.gap.systems.likelihood.logs import LogModel

RATE_HZ, STEPS, PLAY_RAD = 25.0, 20, 0.15
STIFFNESS, DAMPING = 100.0, 15.0
BACKLASH = "backlash@command_rad"


class Servo(System):
    """A servo whose two gains nobody has measured, and whose gears have no play."""

    rate_hz = RATE_HZ
    inputs = [Input("command_rad", "rad")]
    states = {"angle_rad": "rad", "speed_radps": "rad/s"}
    outputs = [Output("angle_rad", "rad", noise=2e-3)]
    constants = [
        Constant("stiffness", STIFFNESS, spread=float("inf"), unit="1/s^2"),
        Constant("damping", DAMPING, spread=float("inf"), unit="1/s"),
    ]
    ports = [Port.input("command_rad", kinds=["backlash", "bias"])]

    def derivative(self, state, inputs, c):
        pull = c.stiffness * (inputs.command_rad - state.angle_rad)
        return {"angle_rad": state.speed_radps, "speed_radps": pull - c.damping * state.speed_radps}


def recorded() -> Recording:
    """A servo with play in its gears under slow waves, in small steps of our own."""
    random = np.random.default_rng(0)
    time_s = np.arange(800) / RATE_HZ
    command = np.zeros(len(time_s))
    for hz in random.uniform(1.0 / 12.0, 1.0 / 4.0, 3):
        size, phase = 0.3 * random.uniform(0.3, 1.0), random.uniform(0.0, 6.0)
        command += size * np.sin(2.0 * np.pi * hz * time_s + phase)
    held = angle = command[0]
    speed, shown = 0.0, []
    for asked in command:
        shown.append(angle + 4e-3 * random.standard_normal())
        held = min(max(held, asked - 0.5 * PLAY_RAD), asked + 0.5 * PLAY_RAD)
        push = 0.3 * random.standard_normal()
        for _ in range(STEPS):
            rate = STIFFNESS * (held - angle) - DAMPING * speed + push
            speed += rate / (RATE_HZ * STEPS)
            angle += speed / (RATE_HZ * STEPS)
    return Recording("made", time_s, {"command_rad": command, "angle_rad": np.array(shown)})


@pytest.mark.whole
def test_what_no_look_promises_is_climbed_from_a_usual_size() -> None:
    """The servo's gains have become a few times softer, which delays it as the play does."""
    model = LogModel(Servo(), [recorded()])
    base = fitted_base(model)
    assert base.value("constant.stiffness") < 0.3 * STIFFNESS
    names = list(model.effects)
    seen = looks(model, Ground.of(base), names)
    assert all(look.prospect(base) < RULES.least_nats for look in seen)
    ranking, chance = ranked(model, base, names)
    assert ranking[0].name == BACKLASH
    assert ranking[0].gain_nats > 10.0 * chance.nats
    fitted = ranking[0].fit
    assert fitted.value(f"{BACKLASH}.width") == pytest.approx(PLAY_RAD, rel=0.1)
