"""Discrete systems, effects of one's own, several logs at once, and a search that is stopped."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from wakedeploy.cli import main
from wakedeploy.core.recording import Recording
from wakedeploy.gap import workflow
from wakedeploy.gap.search.judging import fitted_base, named
from wakedeploy.gap.search.outcome import verdict_of
from wakedeploy.gap.systems.correction import correction_of
from wakedeploy.gap.systems.files import read_system
from wakedeploy.gap.systems.likelihood.logs import LogModel

TANK = """
from wakedeploy import Constant, Input, Output, Port, System


def evaporated(t, state, inputs, p):
    return {"level_m": -p.rate * state.level_m**2}


class Tank(System):
    rate_hz = 10.0
    inputs = [Input("pump_v", "V")]
    states = {"level_m": "m"}
    outputs = [Output("level_m", "m", noise=1e-3)]
    constants = [Constant("kept", 0.97, spread=0.001, unit="1")]
    ports = [
        Port.input("pump_v", kinds=["dead-time", "gain"]),
        Port.custom("evaporation", evaporated, {"rate": ("1/m", 0.01)}),
    ]

    def step(self, state, inputs, c):
        return {"level_m": c.kept * state.level_m + 0.02 * inputs.pump_v}
"""
RATE = 0.03


@pytest.fixture(scope="module")
def tank(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("own") / "tank.py"
    path.write_text(TANK)
    for seed in (0, 1):
        log = recorded(seed)
        columns = np.column_stack([log.time_s, log.columns["pump_v"], log.columns["level_m"]])
        header = "time_s,pump_v,level_m"
        np.savetxt(path.parent / f"{seed}.csv", columns, "%.9g", ",", header=header, comments="")
    return path


def recorded(seed: int) -> Recording:
    """The tank, stepped here, from which some of the water evaporates."""
    random = np.random.default_rng(seed)
    pump = np.repeat(random.uniform(0.0, 2.0, 20), 20)
    level, shown = 1.0 + seed, []
    for volts in pump:
        shown.append(level + 1e-3 * random.standard_normal())
        level += -0.03 * level + 0.02 * volts - RATE * level**2 + 1e-3 * random.standard_normal()
    columns = {"pump_v": pump, "level_m": np.array(shown)}
    return Recording(f"day {seed}", np.arange(len(pump)) / 10.0, columns)


@pytest.mark.slow
def test_a_discrete_system_names_an_effect_of_the_user_s_own_over_several_logs(tank: Path) -> None:
    model = LogModel(read_system(tank), [recorded(0), recorded(1)])
    assert {block.log for block in model.blocks} == {0, 1}
    told = named(model, fitted_base(model))
    assert verdict_of(told) == "named"
    assert told.found.hypothesis == ("evaporation",)
    low, high = told.found.interval("evaporation.rate")
    assert low <= RATE <= high
    assert high - low < 0.5 * RATE
    better = read_system(tank)
    better.correction = correction_of(model, told.found)
    third = recorded(2)
    off = better.simulate(third)["level_m"] - third.columns["level_m"]
    assert np.sqrt(np.mean(off**2)) < 0.01


@pytest.mark.whole
def test_what_had_finished_before_it_was_stopped_is_kept(
    tank: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C during the search: the same command goes on behind the fit, and finds the same."""

    def stopped(*_: object) -> None:
        raise KeyboardInterrupt

    logs = [str(tank.parent / f"{seed}.csv") for seed in (0, 1)]
    command = ["gap", "add", "--system", str(tank), "--measured", *logs, "--out", str(tmp_path)]
    with monkeypatch.context() as patched:
        patched.setattr(workflow, "named", stopped)
        told = CliRunner().invoke(main, command)
    assert told.exit_code == 130
    assert "finished steps are kept" in told.output
    assert sorted(p.name for p in tmp_path.glob("*.*") if p.suffix != ".lock") == ["find.json"]
    fitted = (tmp_path / "find.json").read_bytes()
    monkeypatch.setattr(workflow, "fitted_base", stopped)
    told = CliRunner().invoke(main, command)
    assert told.exit_code == 0, told.output
    assert "lacks `evaporation`" in told.output
    assert (tmp_path / "find.json").read_bytes() == fitted
    assert 'name = "evaporation"' in (tmp_path / "correction.toml").read_text()
