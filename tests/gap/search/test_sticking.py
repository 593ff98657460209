"""What friction holds, and what took the friction's place: a servo that sticks under a weight."""

import functools

import numpy as np
import pytest
from plain_servo import DAMPED, RATE_HZ, STIFF, Servo

from wakedeploy import Input, Output, Port
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import Fit, own_places
from wakedeploy.gap.evidence.inference import fit, settled
from wakedeploy.gap.search.artefacts import Round
from wakedeploy.gap.search.comparison import theta_from
from wakedeploy.gap.search.imitation import imitated
from wakedeploy.gap.search.outcome import Named
from wakedeploy.gap.search.scan import ranked
from wakedeploy.gap.search.sticking import begun_moving
from wakedeploy.gap.search.withdrawal import still_needed
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.likelihood.logs import LogModel

pytestmark = pytest.mark.whole

FINE, STICKS, WEIGHS = 40, 40.0, 36.0
FRICTION, BACKLASH = "coulomb-friction@speed_radps", "backlash@command_rad"
CONSTANT = {"bias@command_rad", "offset@speed_radps", "sensor-bias@angle_rad"}


def _log(weighs: float) -> Recording:
    """Slow motions and steps; friction takes at most what moves, as it does between steps."""
    rng, n = np.random.default_rng(1), 1600
    time_s = np.arange(n) / RATE_HZ
    steps = rng.uniform(-0.3, 0.3, n // 80).repeat(80)
    command = np.where(time_s % 16.0 < 8.0, 0.5 * np.sin(1.1 * time_s), steps)
    angle, speed, shown = command[0], 0.0, []
    for wanted in command:
        shown.append(angle)
        for _ in range(FINE):
            pull = STIFF * (wanted - angle) - DAMPED * speed + weighs + rng.normal(0.0, 2.0)
            speed += pull / RATE_HZ / FINE
            speed = np.sign(speed) * max(abs(speed) - STICKS / RATE_HZ / FINE, 0.0)
            angle += speed / RATE_HZ / FINE
    read = np.array(shown) + rng.normal(0.0, 5e-4, n)
    return Recording("servo", time_s, {"command_rad": command, "angle_rad": read})


@functools.cache
def _fitted(weighs: float, hypothesis: tuple[str, ...]) -> tuple[LogModel, Fit]:
    """The servo with some effects, each begun at its first usual size."""
    model = LogModel(checked(Servo()), [_log(weighs)])
    free = model.free(hypothesis)
    start = np.array([f.starts[0] if f.starts else f.neutral for f in free])
    episodes = range(model.episodes)
    return model, settled(model, fit(model, hypothesis, episodes, start))[0]


def test_a_weight_that_friction_bears_is_found_beside_it():
    """From nothing no climb gets there: the friction holds a small push."""
    model, sticking = _fitted(WEIGHS, (FRICTION,))
    both = (FRICTION, "offset@speed_radps")
    rested = fit(model, both, sticking.episodes, theta_from(model, both, sticking))
    assert rested.objective < sticking.objective + 1.0
    moving = begun_moving(model, sticking, list(model.effects))
    assert set(moving) == CONSTANT
    assert all(f.objective > sticking.objective + 20.0 for f in moving.values())
    assert not begun_moving(model, sticking, [FRICTION])
    ranking, _ = ranked(model, sticking, sorted(CONSTANT))
    gains = {c.name: c.gain_nats for c in ranking}
    assert min(gains.values()) > 500.0
    assert max(gains.values()) < min(gains.values()) + 3.0  # the servo pulls back at once
    weight = next(c.fit for c in ranking if c.name == "offset@speed_radps")
    assert weight.value("offset@speed_radps.force") == pytest.approx(WEIGHS, rel=0.1)
    assert weight.value(f"{FRICTION}.force") == pytest.approx(STICKS, rel=0.1)


def test_an_effect_begins_where_it_does_what_the_best_one_does():
    """A weight of a size that is not usual, beside a bias of the command that does as much."""
    model, sticking = _fitted(WEIGHS, (FRICTION,))
    weight, bias = "offset@speed_radps", "bias@command_rad"
    fits = {}
    for name, size in ((weight, 0.0), (bias, WEIGHS / STIFF)):
        start = theta_from(model, (FRICTION, name), sticking)
        start[own_places(model.free((FRICTION, name)), name)] = size
        fits[name] = fit(model, (FRICTION, name), sticking.episodes, start)
    assert fits[weight].objective < fits[bias].objective - 100.0
    moved = imitated(model, sticking, fits)[weight]
    assert moved.objective > fits[bias].objective - 5.0
    assert moved.value(f"{weight}.force") == pytest.approx(WEIGHS, rel=0.1)


def test_constant_effects_of_an_axis_are_those_of_its_driver_and_its_sensor():
    """An encoder under another name, and another input that drives nothing."""

    class Told(Servo):
        inputs = [Input("command_rad", "rad"), Input("battery_v", "V")]
        outputs = [Output("encoder_rad", "rad", noise=5e-4), Output("current_a", "A")]
        ports = [
            *(Port.input(n) for n in ("command_rad", "battery_v")),
            Port.force("speed_radps", position="angle_rad"),
            *(Port.output(n) for n in ("encoder_rad", "current_a")),
        ]

        def measure(self, state, inputs, c):
            return {"encoder_rad": state.angle_rad, "current_a": state.speed_radps**2}

    columns = dict(_log(0.0).columns)
    columns["encoder_rad"] = columns.pop("angle_rad")
    columns |= {"battery_v": 12.0 + 0.1 * np.sin(_log(0.0).time_s)}
    columns |= {"current_a": columns["encoder_rad"] ** 2}
    model = LogModel(checked(Told()), [Recording("told", _log(0.0).time_s, columns)])
    held = {"bias@command_rad", "offset@speed_radps", "sensor-bias@encoder_rad"}
    assert set(model.held_by_friction((FRICTION,))) == held
    assert model.held_by_friction(("viscous-friction@speed_radps",)) == []


def test_what_was_named_first_leaves_if_a_later_effect_explains_all_of_it():
    """Beside a play that took its place a friction is small; without the play it is not."""
    model, both = _fitted(0.0, (BACKLASH, FRICTION))
    start = theta_from(model, both.hypothesis, both)
    start[own_places(both.free, BACKLASH)] = 2.0 * STICKS / STIFF
    start[own_places(both.free, FRICTION)[0]] = 0.1
    episodes = both.episodes
    found = fit(model, both.hypothesis, episodes, start)
    base = settled(model, fit(model, (), episodes))[0]
    searched = Round(given=[], threshold_nats=5.0, steady_nats=5.0, ranking=[])
    left = still_needed(model, Named(model, base, found, [searched])).found
    assert left.hypothesis == (FRICTION,)
    assert left.value(f"{FRICTION}.force") == pytest.approx(STICKS, rel=0.1)
