"""What is said of how long a search takes, before it begins."""

import itertools
from types import SimpleNamespace
from typing import ClassVar

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.recording import Recording
from wakedeploy.gap.systems import duration
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.duration import long_search
from wakedeploy.gap.systems.likelihood.logs import LogModel


class Cart(System):
    """A cart, as a simulator would give it: point after point."""

    rate_hz = 50.0
    inputs: ClassVar = [Input("force_n", "N")]
    states: ClassVar = {"place_m": "m", "speed_mps": "m/s"}
    outputs: ClassVar = [Output("place_m", "m", noise=1e-3)]
    constants: ClassVar = [Constant("mass_kg", 2.0, spread=0.1)]
    ports: ClassVar = [Port.force("speed_mps", inertia="mass_kg", position="place_m")]
    costs_by_point = True

    def derivative(self, state, inputs, c):
        return {"place_m": state.speed_mps, "speed_mps": inputs.force_n / c.mass_kg}


class PlainCart(Cart):
    """The same, of which numpy takes many points at once."""

    costs_by_point = False


def model_of(cart: type[Cart]) -> LogModel:
    time_s = np.arange(100) / 50.0
    columns = {"force_n": np.sin(3.0 * time_s), "place_m": 0.1 * np.sin(time_s)}
    return LogModel(checked(cart()), [Recording("log", time_s, columns)])


@pytest.mark.parametrize(
    ("passes_s", "said"),
    [
        (0.01, ("", "")),
        (0.1, ("20 seconds", "3 minutes")),
        (1.0, ("3 minutes", "30 minutes")),
        (16.0, ("an hour", "8 hours")),
    ],
)
def test_a_search_that_takes_long_is_said_before_with_what_shortens_it(
    monkeypatch, passes_s, said
) -> None:
    """By a clock of its own: `passes_s` for the eight sets that are timed."""
    clock = itertools.count(step=passes_s)
    monkeypatch.setattr(duration, "time", SimpleNamespace(perf_counter=lambda: next(clock)))
    for cart, why in (
        (Cart, ", as each of its points is computed by the simulator"),
        (PlainCart, ""),
    ):
        _is_said(model_of(cart), passes_s, why, said)


def _is_said(model: LogModel, passes_s: float, why: str, said: tuple[str, str]) -> None:
    effects = len(model.library)
    least, most = said
    notes = long_search(model)
    if not most:
        assert notes == []
        return
    for told, sets in ((least, 100.0), (most, 1000.0)):
        assert told == duration._rounded(sets * effects * passes_s / 8.0)
    many = f"(2 states, {effects} effects)"
    assert f"between {least} and {most} here {many}{why}, and more where" in notes[0]
    assert "spread=0" in notes[0]


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(4, "10 seconds"), (30, "30 seconds"), (60, "a minute"), (100, "2 minutes"),
     (200, "3 minutes"), (300, "5 minutes"),
     (500, "10 minutes"), (1750, "30 minutes"), (2600, "40 minutes"),
     (3000, "an hour"), (6000, "2 hours"), (40_000, "11 hours")],
)  # fmt: skip
def test_a_guess_is_told_no_finer_than_it_is_worth(seconds: float, said: str) -> None:
    assert duration._rounded(seconds) == said
