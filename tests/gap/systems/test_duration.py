"""What is said of how long a search takes, of systems that are asked for each point."""

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


def test_of_a_search_that_is_soon_done_nothing_is_said() -> None:
    assert long_search(model_of(Cart)) == []


def test_a_search_that_takes_long_is_said_before_with_what_shortens_it(monkeypatch) -> None:
    monkeypatch.setattr(duration, "_WORTH_SAYING_S", 0.0)
    (said,) = long_search(model_of(Cart))
    effects = len(model_of(Cart).library)
    assert f"minutes here (2 states, {effects} effects), as each of its points is" in said
    assert "spread=0" in said
    assert long_search(model_of(PlainCart)) == []


@pytest.mark.parametrize(
    ("seconds", "said"),
    [(300, "5 minutes"), (500, "10 minutes"), (1750, "30 minutes"), (2600, "40 minutes"),
     (3000, "an hour"), (6000, "2 hours"), (40_000, "11 hours")],
)  # fmt: skip
def test_a_guess_is_told_no_finer_than_it_is_worth(seconds: float, said: str) -> None:
    assert duration._rounded(seconds) == said
