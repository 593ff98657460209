"""The documentation of the effects: its table is the library's, its example works."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from effect_rigs import HOVER_US, NO_WAKE, WEIGHT_N, flown

from wakedeploy.physics import effects
from wakedeploy.physics.effects import LIBRARY, Effect, chain, equation_table, markdown_table
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig.file import parse_rig

DOCS = Path(__file__).parents[3] / "docs"
PAGE = (DOCS / "reference" / "effects.md").read_text("utf-8")
OWN = (DOCS / "how-to" / "own-effect.md").read_text("utf-8")


@pytest.mark.parametrize("made", [markdown_table, equation_table])
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
