"""A search where each parameter set takes as long as the first: as good, with fewer of them."""

import numpy as np
import pytest
from plain_servo import DAMPED, RATE_HZ, STIFF, Servo

from wakedeploy import Port
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.fits import Fit, extended, own_places
from wakedeploy.gap.evidence.inference import fit, settled
from wakedeploy.gap.search import scan
from wakedeploy.gap.search.first_look import starts_of
from wakedeploy.gap.search.imitation import _followed, doing_alike
from wakedeploy.gap.search.judging import fitted_base
from wakedeploy.gap.search.scan import ranked
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.likelihood.logs import LogModel

FINE = 20


class Dear(Servo):
    """A servo as an outside simulator would give it."""

    ports = [
        Port.input("command_rad", kinds=["dead-time", "lag", "backlash", "gain"]),
        Port.force("speed_radps", position="angle_rad",
                   kinds=["coulomb-friction", "viscous-friction", "stiffness", "offset"]),
        Port.output("angle_rad", kinds=["sensor-gain", "sensor-lag", "sensor-dead-time"]),
    ]  # fmt: skip
    costs_by_point = True


class Counted(LogModel):
    """Counts parameter sets; `is_dear` as it is told, and nothing is scored ahead."""

    def __init__(self, log: Recording, dear: bool) -> None:
        self.sets, self._dear = 0, dear
        super().__init__(checked(Dear()), [log])

    @property
    def is_dear(self) -> bool:
        return self._dear

    def sets_at_once(self, episodes):
        return 1

    def scores(self, hypothesis, thetas, episodes):
        self.sets += len(thetas)
        return super().scores(hypothesis, thetas, episodes)


def _log(sticks: float, late: int, adds: float) -> Recording:
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


@pytest.mark.whole
@pytest.mark.parametrize(
    ("hidden", "truth", "most"),
    [
        ({"sticks": 20.0, "late": 0, "adds": 0.0}, {"coulomb-friction@speed_radps"}, 1.0),
        ({"sticks": 0.0, "late": 2, "adds": 0.0},
         {"dead-time@command_rad", "sensor-dead-time@angle_rad"}, 0.4),
        ({"sticks": 0.0, "late": 0, "adds": 8.0}, {"offset@speed_radps"}, 0.9),
    ],
)  # fmt: skip
def test_a_dear_system_has_the_same_leaders_for_fewer_sets(hidden, truth, most):
    log, tops, sets = _log(**hidden), [], []
    for dear in (False, True):
        model = Counted(log, dear)
        base = fitted_base(model)
        model.sets = 0
        ranking, _ = ranked(model, base, list(model.effects))
        sets.append(model.sets)
        tops.append({c.name: c.gain_nats for c in ranking[:4]})
    thorough, frugal = tops
    best = max(thorough.values())
    equal = {n for n, gain in thorough.items() if gain > best - 5.0}
    assert truth & equal
    for name in equal:
        assert frugal[name] == pytest.approx(thorough[name], abs=1.0)
    assert sets[1] < most * sets[0]


def test_what_does_as_the_leader_does_follows_it_by_its_slopes():
    """Beside a fitted lag, with its noise and constants, a delay costs more than it gains."""
    model = Counted(_log(sticks=0.0, late=2, adds=0.0), dear=True)
    base = fitted_base(model)
    lag = fit(model, ("lag@command_rad",), base.episodes, _started(model, base, "lag@command_rad"))
    delay = ("dead-time@command_rad",)
    alike = doing_alike(model, base, lag, [delay])
    assert alike[delay].objective < base.objective
    model.sets = 0
    followed = _followed(model, base, lag, alike)
    assert followed[delay].objective > 0.5 * (base.objective + lag.objective)
    assert model.sets < 3 * len(lag.free)


def _started(model: LogModel, base: Fit, name: str) -> np.ndarray:
    free = model.free((name,))
    return starts_of(extended(base, free), free, own_places(free, name))[0]


def test_where_nothing_is_missing_a_dear_system_is_asked_for_no_more_sets():
    log, sets = _log(sticks=0.0, late=0, adds=0.0), []
    for dear in (False, True):
        model = Counted(log, dear)
        base = fitted_base(model)
        model.sets = 0
        ranking, chance = ranked(model, base, list(model.effects))
        assert ranking[0].gain_nats < chance.nats
        sets.append(model.sets)
    assert sets[1] <= sets[0]


@pytest.mark.whole
def test_what_a_friction_holds_comes_to_rest_beside_it(monkeypatch):
    """Also where it promises so little at 0 that a look chooses none."""
    monkeypatch.setattr(scan, "CLIMBED", 0)
    log, gains = _log(sticks=20.0, late=0, adds=15.0), []
    for dear in (False, True):
        model = Counted(log, dear)
        hypothesis = ("coulomb-friction@speed_radps",)
        start = _started(model, fit(model, (), range(model.episodes)), hypothesis[0])
        base = settled(model, fit(model, hypothesis, range(model.episodes), start))[0]
        ranking, _ = ranked(model, base, ["offset@speed_radps"])
        gains.append(ranking[0].gain_nats)
        assert settled(model, ranking[0].fit)[0].objective < ranking[0].fit.objective + 0.3
    assert gains[1] > 50.0
    assert gains[1] == pytest.approx(gains[0], abs=1.0)
