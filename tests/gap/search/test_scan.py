"""Which candidates of a scan are climbed to the end, where a race has left them on the way."""

from types import SimpleNamespace

import numpy as np
import pytest

from wakedeploy.gap.evidence.fits import Free
from wakedeploy.gap.evidence.ranking import Candidate
from wakedeploy.gap.search import scan
from wakedeploy.gap.search.comparison import ComparisonDefaults


class _Frictions(ComparisonDefaults):
    """Nothing to fit; "finer@v" has more to it than "dry@v"."""

    effects = ("finer@v", "dry@v")

    def simpler_effects(self, name):
        return ["dry@v"] if name == "finer@v" else []

    def free(self, hypothesis):
        return tuple(_free(f"{name}.size", "N") for name in hypothesis)


def _free(name, unit):
    return Free(name, unit, 0.0, 1.0, 0.0, 10.0, 1e-3, (0.1,))


def _fit(name, unit="N", objective=0.0):
    free, theta = (_free(f"{name}.size", unit),), np.array([0.5])
    return SimpleNamespace(
        hypothesis=(name,), free=free, names=[free[0].name], theta=theta, objective=objective,
        value=lambda _: 0.5,
    )  # fmt: skip


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


@pytest.mark.parametrize(("unit", "asked"), [("s", True), ("N", False)])
def test_a_delay_that_promises_nothing_is_asked_where_it_looks_like_the_leading_one(
    monkeypatch, unit, asked
):
    monkeypatch.setattr(scan, "_likeness", lambda *given: 0.9)
    monkeypatch.setattr(scan, "to_the_end", lambda model, base, points, fitted: points)
    order = [
        SimpleNamespace(name="lag@y", promised=0.0, fit=_fit("lag@y", "s", 20.0)),
        SimpleNamespace(name="delay@u", promised=0.0, fit=_fit("delay@u", unit)),
    ]
    fitted = {seen.name: seen.fit for seen in order}
    ground = SimpleNamespace(base=None)
    alike = scan._lookalikes(None, ground, order, fitted, {"lag@y": fitted["lag@y"]})
    assert ("delay@u" in alike) == asked
    late = [float(p[0]) for p in alike.get("delay@u", [])]
    assert late == ([0.5, 0.5, 1.0] if asked else [])  # as it is, as late, and twice as late
