"""The documentation of the effects: its table is the library's, its example works."""

import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from effect_rigs import HOVER_US, NO_WAKE, WEIGHT_N, flown

from benchmarks.results.effects import TABLES
from wakedeploy.gap.systems.kinds.kind import Scales
from wakedeploy.physics import effects
from wakedeploy.physics.effects import LIBRARY, Effect, chain
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig.file import parse_rig

DOCS = Path(__file__).parents[3] / "docs"
PAGE = (DOCS / "reference" / "effects.md").read_text("utf-8")
OWN = (DOCS / "how-to" / "own-effect.md").read_text("utf-8")


@pytest.mark.parametrize("made", TABLES)
def test_the_tables_are_up_to_date(made: Callable[[], str]) -> None:
    name = made.__name__
    table = re.search(rf"{name}\(\) -->\n(.*?)<!-- end of table -->", PAGE, re.DOTALL)
    assert table is not None
    assert table.group(1) == made()
    assert len(made().splitlines()) == 2 + len(LIBRARY)


def test_the_rig_file_on_the_page_flies() -> None:
    toml = re.search(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    assert toml is not None
    run = flown(GantryPlant(parse_rig(NO_WAKE.text + "\n" + toml.group(1)), seed=0), 1.0)
    assert run["z_m"][-1] > 0.02  # hover thrust lifts it off a base with ground effect


def test_the_example_class_flies_once_it_is_in_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    source = re.search(r"```python\n(.*?)```", OWN, re.DOTALL)
    assert source is not None
    namespace: dict[str, Any] = {}
    exec(source.group(1), namespace)
    one: Effect = namespace["MotorHeating"]()
    grown = {**LIBRARY, one.name: one}
    monkeypatch.setattr(effects, "LIBRARY", grown)
    monkeypatch.setattr(chain, "LIBRARY", grown)
    entry = (
        '[[effect]]\nname = "motor-heating"\nparameters = { '
        'loss = { value = 0.1, unit = "1" }, warming_s = { value = 2.0, unit = "s" } }'
    )
    rig = parse_rig(NO_WAKE.without("spool").text + "\n" + entry)
    run = flown(GantryPlant(rig, seed=0), 6.0, sufferer_us=lambda t_s: HOVER_US)
    assert run["sufferer_thrust_n"][0] == pytest.approx(WEIGHT_N)
    assert run["sufferer_thrust_n"][-1] == pytest.approx((1.0 - 0.1 * 0.9502) * WEIGHT_N, rel=1e-4)


def test_the_examples_for_any_system_act() -> None:
    _, own, for_all = re.findall(r"```python\n(.*?)```", OWN, re.DOTALL)
    made: dict[str, Any] = {}
    exec(own, made)
    state, parameters = SimpleNamespace(position_m=2.0), SimpleNamespace(stiffness=5.0)
    assert made["cable"].function(0.0, state, None, parameters) == {"speed_mps": -40.0}
    exec(for_all, made)
    drag = made["CubicDrag"]()
    at = SimpleNamespace(speed=np.array([2.0, -2.0]))
    assert drag.force(at, {"coefficient": 0.5}) == pytest.approx([-4.0, 4.0])
    scales = Scales({"force": 8.0, "speed": 2.0}, {"force": "N", "speed": "m/s"})
    assert drag.parameters[0].size(scales) == 1.0
    assert drag.parameters[0].unit(scales) == "N/(m/s)³"
