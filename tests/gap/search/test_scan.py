"""Which candidates of a scan are climbed to the end, where a race has left them on the way."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear_model import EPISODES, Linear

from wakedeploy.gap.evidence.ascent import promised_nats
from wakedeploy.gap.evidence.fits import NO_SLOPES, Free
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import Candidate
from wakedeploy.gap.search import scan
from wakedeploy.gap.search.climbing import begun, fresh
from wakedeploy.gap.search.comparison import ComparisonDefaults


class _Frictions(ComparisonDefaults):
    """Nothing to fit; "finer@v" has more to it than "dry@v"."""

    effects = ("finer@v", "dry@v")

    def simpler_effects(self, name):
        return ["dry@v"] if name == "finer@v" else []

    def free(self, hypothesis):
        return tuple(_free(f"{name}.size") for name in hypothesis)


def _free(name):
    return Free(name, "N", 0.0, 1.0, 0.0, 10.0, 1e-3, (0.1,))


def _fit(name, objective=0.0):
    free, theta = (_free(f"{name}.size"),), np.array([0.5])
    return SimpleNamespace(
        hypothesis=(name,), free=free, names=[free[0].name], theta=theta, objective=objective,
        value=lambda _: 0.5, slopes=NO_SLOPES,
    )  # fmt: skip


def test_only_what_is_higher_replaces_a_fit(monkeypatch):
    """Where chance gains more than all, those not raced are climbed from their starts, too."""
    at = {"raced": 30.0, "looked": 12.0, "lower": 5.0}
    fits = {where: _fit("dry@v", objective) for where, objective in at.items()}
    seen = [SimpleNamespace(name=n, fit=f, prospect=lambda base, f=f: f.objective)
            for n, f in (("finer@v", fits["raced"]), ("dry@v", fits["looked"]))]  # fmt: skip
    asked = []

    def compared(model, ground, order, fitted):
        asked.append({n: f.objective for n, f in fitted.items()})
        best = sorted(fitted, key=lambda n: -fitted[n].objective)
        gains = [Candidate(n, fitted[n], np.array([fitted[n].objective])) for n in best]
        return gains, SimpleNamespace(nats=40.0)

    monkeypatch.setattr(scan, "CLIMBED", 1)
    monkeypatch.setattr(scan.Ground, "of", lambda base: None)
    monkeypatch.setattr(scan, "looks", lambda *given: seen)
    monkeypatch.setattr(scan, "raced", lambda model, base, starts: list(starts))
    monkeypatch.setattr(scan, "to_the_end", lambda model, base, points, fitted: fitted)
    monkeypatch.setattr(scan, "begun_moving", lambda *given: {})
    monkeypatch.setattr(scan, "imitated", lambda model, base, fitted: fitted)
    monkeypatch.setattr(scan, "_compared", compared)
    base = SimpleNamespace(hypothesis=(), objective=0.0)
    for further in ("lower", "raced"):
        monkeypatch.setattr(
            scan, "_from_their_starts", lambda *given, f=further: {"dry@v": fits[f]}
        )
        scan.ranked(_Frictions(), base, ["finer@v", "dry@v"])
    assert [each["dry@v"] for each in asked] == [12.0, 12.0, 30.0]


@pytest.mark.parametrize(("size", "is_climbed"), [(0.6, True), (0.4, True), (0.1, False)])
def test_what_a_race_left_on_its_way_is_climbed_if_its_slopes_promise_enough(size, is_climbed):
    """A linear model's slopes promise exactly what is left; others may promise a third of it."""
    model = Linear({"a": 0.6, "c": size})
    base, *tops = (fit(model, h, range(EPISODES)) for h in ((), ("a",), ("c",)))
    start = begun(model, ("c",), base, np.append(base.theta, 0.0))
    short = fresh(model, start, start.theta)
    assert promised_nats(short) == pytest.approx(tops[1].objective - short.objective, abs=0.1)
    assert promised_nats(tops[1]) == pytest.approx(0.0, abs=0.1)
    fitted = {"a": tops[0], "c": short}
    rested = scan._rested(model, base, {"a": base}, fitted, {"a": tops[0]})
    assert set(rested) == ({"c"} if is_climbed else set())
    for found in rested.values():
        assert found.objective == pytest.approx(tops[1].objective, abs=0.1)
    lost = replace(short.slopes, innovation=(short.slopes.innovation[0] * 1e250,) * EPISODES)
    assert promised_nats(replace(short, slopes=lost)) == 0.0


@pytest.mark.filterwarnings("error")
def test_what_chance_brings_to_columns_of_any_size_is_the_same():
    """A finite difference into a state that has left its model is of any size, or none."""
    rng = np.random.default_rng(0)
    ground = SimpleNamespace(residual=lambda columns: columns)
    columns = rng.standard_normal((40, 3))
    plain = scan._basis(columns, ground)
    large = scan._basis(columns * np.array([1e-200, 1.0, 1e250]), ground)
    assert np.abs(large @ large.T - plain @ plain.T).max() < 1e-12
    columns[3, 1] = np.inf
    assert scan._basis(columns, ground).shape == (40, 2)
    assert scan._basis(np.zeros((40, 2)), ground).shape == (40, 0)


def test_ports_that_are_alike_do_not_fill_a_race():
    """Gain and drift of each wheel promise more at first sight than the dead time that it is."""
    wheels = ("left", "right")
    order = ["gain", "drift", "hold", "dead-time", "lag", "rate-limit", "backlash"]
    looks = [SimpleNamespace(name=f"{kind}@{wheel}") for kind in order for wheel in wheels]
    names = [seen.name for seen in scan._raced_among(looks)]
    assert names == [f"{kind}@{wheel}" for kind in order[:6] for wheel in wheels]
    alone = [SimpleNamespace(name=f"{kind}@left") for kind in order]
    assert [seen.name for seen in scan._raced_among(alone)] == [f"{k}@left" for k in order[:6]]
    rotors = [SimpleNamespace(name=f"{kind}@{k}") for kind in order for k in range(20)]
    raced = [seen.name for seen in scan._raced_among(rotors)]
    assert raced == [f"{kind}@{k}" for kind in order[:6] for k in range(2)]
    many = [SimpleNamespace(name=f"bias@{k}") for k in range(40)]
    assert [seen.name for seen in scan._raced_among(many)] == [f"bias@{k}" for k in range(12)]


@pytest.mark.parametrize(("summit", "named"), [(30.0, "dry@v"), (20.0, "finer@v")])
def test_a_simpler_kind_is_climbed_to_its_summit_before_it_loses_its_name(
    monkeypatch, summit, named
):
    begun_at = []
    gains = {"raced": 25.0, "ended": summit, "known": 5.0}
    fits = {where: _fit("dry@v") for where in gains}

    def ended(model, base, points, fitted):
        begun_at.extend(points)
        return fits["ended"]

    def judged(base, name, fitted, model):
        where = next(k for k, f in fits.items() if f is fitted)
        return Candidate(name, fitted, np.array([gains[where]]))

    monkeypatch.setattr(scan, "climbed", lambda model, start: fits["raced"])
    monkeypatch.setattr(scan, "begun", lambda *given: None)
    monkeypatch.setattr(scan, "to_the_end", ended)
    monkeypatch.setattr(scan, "candidate", judged)
    best = Candidate("finer@v", _fit("finer@v"), np.array([35.0]))
    known = Candidate("dry@v", fits["known"], np.array([gains["known"]]))
    base = SimpleNamespace(hypothesis=(), episodes=(0,))
    assert scan.simpler(_Frictions(), base, best, [known]).name == named
    assert [p.tolist() for p in begun_at] == [[0.5], [0.5]]  # of the best one, and its own
