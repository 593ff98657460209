"""The best candidates are found without a climb of each to its end."""

import numpy as np
import pytest
from plain_servo import DAMPED, RATE_HZ, STIFF, Servo

from wakedeploy import Port
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import Fit, extended, own_places
from wakedeploy.gap.evidence.inference import fit, settled
from wakedeploy.gap.evidence.ranking import candidate
from wakedeploy.gap.search import scan
from wakedeploy.gap.search.first_look import starts_of
from wakedeploy.gap.search.imitation import _followed, doing_alike
from wakedeploy.gap.search.judging import fitted_base
from wakedeploy.gap.search.scan import ranked
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.likelihood.logs import LogModel

FINE = 20
FRICTION, OFFSET = "coulomb-friction@speed_radps", "offset@speed_radps"
NEARLY = 2.0  # nats of hundreds: fits end a little below their summits


class Shown(Servo):
    """A servo with eleven effects."""

    ports = [
        Port.input("command_rad", kinds=["dead-time", "lag", "backlash", "gain"]),
        Port.force("speed_radps", position="angle_rad",
                   kinds=["coulomb-friction", "viscous-friction", "stiffness", "offset"]),
        Port.output("angle_rad", kinds=["sensor-gain", "sensor-lag", "sensor-dead-time"]),
    ]  # fmt: skip


class Counted(LogModel):
    """Counts the parameter sets that it is asked for."""

    def __init__(self, log: Recording) -> None:
        self.sets = 0
        super().__init__(checked(Shown()), [log])

    def sets_at_once(self, episodes):
        """None is scored ahead of need, as it would be of a system for which sets cost nothing."""
        return 1

    def scores(self, hypothesis, thetas, episodes):
        self.sets += len(thetas)
        return super().scores(hypothesis, thetas, episodes)


def _log(sticks: float = 0.0, late: int = 0, adds: float = 0.0) -> Recording:
    rng, n = np.random.default_rng(2), 900
    time_s = np.arange(n) / RATE_HZ
    steps = rng.uniform(-0.3, 0.3, n // 60).repeat(60)
    command = np.where(time_s % 8.0 < 4.0, 0.5 * np.sin(2.0 * time_s), steps)
    angle, speed, shown = command[0], 0.0, []
    for k in range(n):
        shown.append(angle)
        for _ in range(FINE):
            pull = STIFF * (command[max(k - late, 0)] - angle) - DAMPED * speed + adds
            speed += (pull + rng.normal(0.0, 1.0)) / RATE_HZ / FINE
            speed = np.sign(speed) * max(abs(speed) - sticks / RATE_HZ / FINE, 0.0)
            angle += speed / RATE_HZ / FINE
    read = np.array(shown) + rng.normal(0.0, 5e-4, n)
    return Recording("servo", time_s, {"command_rad": command, "angle_rad": read})


def _starts(model: LogModel, base: Fit, name: str) -> list[np.ndarray]:
    free = model.free((*base.hypothesis, name))
    return starts_of(extended(base, free), free, own_places(free, name))


def _climbed_to_the_end(model: LogModel, base: Fit, name: str) -> Fit:
    """The best of climbs from an effect's smallest and largest usual size, each to its end."""
    hypothesis, starts = (*base.hypothesis, name), _starts(model, base, name)
    ends = [fit(model, hypothesis, base.episodes, at) for at in (starts[0], *starts[1:][-1:])]
    return max((settled(model, end)[0] for end in ends), key=lambda f: f.objective)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("hidden", "truth"),
    [
        ({"sticks": 20.0}, {FRICTION}),
        ({"late": 2}, {"dead-time@command_rad", "sensor-dead-time@angle_rad"}),
        ({"adds": 8.0}, {OFFSET}),
    ],
)
def test_leaders_gain_what_they_do_if_each_is_climbed_to_its_end(hidden, truth):
    model = Counted(_log(**hidden))
    base = fitted_base(model)
    model.sets = 0
    found = {c.name: c.gain_nats for c in ranked(model, base, list(model.effects))[0]}
    of_search, model.sets = model.sets, 0
    ends = {n: _climbed_to_the_end(model, base, n) for n in model.effects}
    gains = {n: candidate(base, n, end, model).gain_nats for n, end in ends.items()}
    best = max(gains.values())
    equal = {n for n, gain in gains.items() if gain > best - 5.0}
    assert truth & equal
    for name in equal:
        assert found[name] > gains[name] - NEARLY
    assert of_search < 0.3 * model.sets


def test_what_does_as_the_leader_does_follows_it_by_its_slopes():
    """Beside a fitted lag, with its noise and constants, a delay costs more than it gains."""
    model = Counted(_log(late=2))
    base = fitted_base(model)
    start = _starts(model, base, "lag@command_rad")[0]
    lag = fit(model, ("lag@command_rad",), base.episodes, start)
    delay = ("dead-time@command_rad",)
    alike = doing_alike(model, base, lag, [delay])
    assert alike[delay].objective < base.objective
    model.sets = 0
    followed = _followed(model, base, lag, alike)
    assert followed[delay].objective > 0.5 * (base.objective + lag.objective)
    assert model.sets < 3 * len(lag.free)


def test_where_nothing_is_missing_nothing_gains_more_than_chance():
    model = Counted(_log())
    ranking, chance = ranked(model, fitted_base(model), list(model.effects))
    assert ranking[0].gain_nats < chance.nats


@pytest.mark.whole
def test_what_a_friction_holds_comes_to_rest_beside_it(monkeypatch):
    """Also where it promises so little at 0 that a look chooses none."""
    monkeypatch.setattr(scan, "CLIMBED", 0)
    model = Counted(_log(sticks=20.0, adds=15.0))
    start = _starts(model, fit(model, (), range(model.episodes)), FRICTION)[0]
    base = settled(model, fit(model, (FRICTION,), range(model.episodes), start))[0]
    (found,) = ranked(model, base, [OFFSET])[0]
    expected = candidate(base, OFFSET, _climbed_to_the_end(model, base, OFFSET), model)
    assert expected.gain_nats > 50.0
    assert found.gain_nats > expected.gain_nats - NEARLY
    assert settled(model, found.fit)[0].objective < found.fit.objective + 0.3
