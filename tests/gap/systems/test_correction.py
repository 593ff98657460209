"""What a correction has where nothing was named: what nobody knew before, or nothing at all."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from tests.gap.report.test_system_page import result
from wakedeploy import Constant, Input, Output, Port, System, UnusableInput
from wakedeploy.cli import main
from wakedeploy.core.recording import Recording
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.systems.answers.folder import OwnFolder, correction_told
from wakedeploy.gap.systems.correction import (
    Correction,
    correction_of,
    read_correction,
    write_correction,
)
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.simulation import replay_error

GAIN = 3.0
SLIDE = """
import math
from wakedeploy import Constant, Input, Output, Port, System


class Slide(System):
    rate_hz = 50.0
    inputs = [Input("push_v", "V")]
    states = {"speed_mps": "m/s"}
    outputs = [Output("speed_mps", "m/s", noise=0.01)]
    constants = [
        Constant("push_n_per_v", GAIN),
        Constant("mass_kg", 2.0, spread=0.1),
        Constant("drag_ns_per_m", 1.0, spread=0.1),
    ]
    ports = [Port.force("speed_mps", inertia="mass_kg", kinds=["offset"])]

    def derivative(self, state, inputs, c):
        pull = c.push_n_per_v * inputs.push_v - c.drag_ns_per_m * state.speed_mps
        return {"speed_mps": pull / c.mass_kg}
"""


class Slide(System):
    """A slide whose motor nobody has measured."""

    rate_hz = 50.0
    inputs = [Input("push_v", "V")]
    states = {"speed_mps": "m/s"}
    outputs = [Output("speed_mps", "m/s", noise=0.01)]
    constants = [
        Constant("push_n_per_v", 1.0, spread=math.inf),
        Constant("mass_kg", 2.0, spread=0.1),
        Constant("drag_ns_per_m", 1.0, spread=0.1),
    ]
    ports = [Port.force("speed_mps", inertia="mass_kg", kinds=["offset"])]

    def derivative(self, state, inputs, c):
        pull = c.push_n_per_v * inputs.push_v - c.drag_ns_per_m * state.speed_mps
        return {"speed_mps": pull / c.mass_kg}


OFFSET = "offset@speed_mps"


class Measured(Slide):
    """The same, with a motor that is known."""

    constants = [Constant("push_n_per_v", GAIN, spread=0.1), *Slide.constants[1:]]


def recorded(seed: int) -> Recording:
    """The slide, exactly between its samples, with noise on its speed."""
    rng = np.random.default_rng(seed)
    volts = np.repeat(rng.standard_normal(40), 25)
    kept, speed, shown = math.exp(-0.5 / 50.0), 0.0, []
    for u in volts:
        shown.append(speed + 0.01 * rng.standard_normal())
        speed = kept * speed + (1.0 - kept) * GAIN * u
    columns = {"push_v": volts, "speed_mps": np.array(shown)}
    return Recording("slide", np.arange(len(volts)) / 50.0, columns)


def fitted_alone(system: System):
    model = LogModel(system, [recorded(0)])
    return correction_of(model, fit(model, (), range(model.episodes)))


@pytest.mark.whole
def test_it_has_the_constants_that_nobody_has_measured_and_no_other(tmp_path: Path) -> None:
    kept = fitted_alone(Slide())
    assert list(kept.document.constants) == ["push_n_per_v"]
    assert kept.document.constants["push_n_per_v"] == pytest.approx(GAIN, rel=0.05)
    assert not kept.document.form
    write_correction(kept, tmp_path / "correction.toml")
    better, other = Slide(), recorded(1)
    better.correction = read_correction(tmp_path / "correction.toml", "Slide")
    assert replay_error(better, other)["speed_mps"] < 0.05
    assert replay_error(Slide(), other)["speed_mps"] > 0.5


class Fast(Measured):
    """A slide that follows its motor within a sample."""

    constants = [
        Constant("push_n_per_v", GAIN, spread=0.1),
        Constant("mass_kg", 0.02, spread=0.001),
        Constant("drag_ns_per_m", 1.0, spread=0.05),
    ]


def misstamped(seed: int, late: float) -> Recording:
    """The fast slide under 0.5 N, exactly; commands act a share of a sample after their rows."""
    rng = np.random.default_rng(seed)
    volts = np.repeat(rng.standard_normal(200), 3)
    acting = np.repeat(volts, 10)  # in tenths of a sample
    acting = acting[np.clip(np.arange(len(acting)) - round(10 * late), 0, len(acting) - 1)]
    kept, speed = math.exp(-0.1), GAIN * volts[0] + 0.5  # the time constant is a sample
    speeds = []
    for u in acting:
        speeds.append(speed)
        speed = kept * speed + (1.0 - kept) * (GAIN * u + 0.5)
    shown = np.array(speeds[::10]) + 0.01 * rng.standard_normal(len(volts))
    columns = {"push_v": volts, "speed_mps": shown}
    return Recording("misstamped", np.arange(len(volts)) / 50.0, columns)


@pytest.mark.whole
@pytest.mark.parametrize("late", [0.4, -0.4])
def test_it_has_when_an_input_acts_within_a_sample(tmp_path: Path, late: float) -> None:
    """Without that a log of the same recorder replays worse."""
    model = LogModel(Fast(), [misstamped(0, late)])
    kept = correction_of(model, fit(model, ("offset@speed_mps",), range(model.episodes)))
    assert kept.document.clocks_s == {"push_v": pytest.approx(late / 50.0, abs=0.03 / 50.0)}
    write_correction(kept, tmp_path / "correction.toml")
    timed, untimed = Fast(), Fast()
    timed.correction = read_correction(tmp_path / "correction.toml", "Fast")
    untimed.correction = Correction(kept.document.model_copy(update={"clocks_s": {}}))
    other = misstamped(1, late)
    error, without = (replay_error(one, other)["speed_mps"] for one in (timed, untimed))
    assert without > 0.3
    assert error < 0.1 * without


@pytest.mark.whole
def test_it_leaves_a_system_whose_constants_are_known_as_it_is() -> None:
    kept = fitted_alone(Measured())
    assert kept.is_empty
    same, other = Measured(), recorded(1)
    same.correction = kept
    np.testing.assert_array_equal(
        same.simulate(other)["speed_mps"], Measured().simulate(other)["speed_mps"]
    )


@pytest.mark.whole
@pytest.mark.parametrize("spread", ["spread=0.1", "spread=math.inf"])
def test_the_command_says_what_it_keeps(tmp_path: Path, spread: str) -> None:
    """An earlier correction, which would pass for this one's, is gone."""
    (tmp_path / "slide.py").write_text(SLIDE.replace("GAIN", f"{GAIN}, {spread}"))
    log = recorded(0)
    rows = np.column_stack([log.time_s, log.columns["push_v"], log.columns["speed_mps"]])
    header = "time_s,push_v,speed_mps"
    np.savetxt(tmp_path / "log.csv", rows, "%.9g", ",", header=header, comments="")
    (tmp_path / "gap").mkdir()
    path = tmp_path / "gap" / "correction.toml"
    path.write_text("of an earlier answer")
    words = ["gap", "add", "--system", str(tmp_path / "slide.py"), "--measured"]
    told = CliRunner().invoke(
        main, [*words, str(tmp_path / "log.csv"), "--out", str(tmp_path / "gap")]
    )
    assert told.exit_code == 0, told.output
    assert json.loads((tmp_path / "gap" / "name.json").read_text())["verdict"] == "none"
    if "inf" in spread:
        kept = f"Correction: {path}, with the constants that nobody has measured, as fitted, for"
        assert kept in told.stdout
        assert list(read_correction(path, "Slide").document.constants) == ["push_n_per_v"]
    else:
        assert "Correction: none, as nothing was named" in told.stdout
        assert not path.exists()


@pytest.mark.parametrize(("verdict", "is_added"), [("class", True), ("unknown", False)])
def test_what_an_unknown_leaves_open_is_in_no_correction(verdict, is_added, tmp_path, monkeypatch):
    model = LogModel(Measured(), [recorded(1)])
    used = [e for e in range(model.episodes) if e not in model.sealed()]
    share = {"share": 0.1, "low": 0.05, "high": 0.15}
    effects = [{"name": OFFSET, "parameters": {}, "forecast": share}]
    answer = result(**{"verdict": verdict, "effects": effects, "class": [OFFSET, "a@b", "c@d"]})
    folder = OwnFolder(model, tmp_path)
    monkeypatch.setattr(folder, "name", lambda: answer)
    monkeypatch.setattr(folder, "found", lambda: (model, fit(model, (OFFSET,), used)))
    folder.add()
    assert (tmp_path / "correction.toml").exists() == is_added
    assert correction_told(tmp_path).startswith("Correction: none") != is_added


def test_a_folder_is_of_one_system_and_what_follows_find_is_of_its_present_form(tmp_path):
    def folder(changed, name="Slide"):
        model = LogModel(type(name, (Measured,), changed)(), [recorded(1)])
        return OwnFolder(model, tmp_path)

    folder({}).find()
    for name in folder({}).later:
        (tmp_path / name).write_text('{"domain": "Slide", "key": "of before"}')
    folder({}).find()  # which is known
    assert all((tmp_path / name).exists() for name in folder({}).later)
    folder({"constants": Slide.constants}).find()
    assert not any((tmp_path / name).exists() for name in folder({}).later)
    with pytest.raises(UnusableInput, match="holds what was found about Slide, and this is Other"):
        folder({}, "Other").find()


def test_an_effect_without_its_port_is_meant(tmp_path):
    model = LogModel(Measured(), [recorded(1)])
    with pytest.raises(UnusableInput, match=r"no effect 'offset'; did you mean offset@speed_mps\?"):
        model.acting(("offset",))


def test_a_file_that_is_no_correction_is_told_to_be_none(tmp_path: Path) -> None:
    """What it lacks would be news to nobody who gave the wrong file."""
    path = tmp_path / "columns.toml"
    path.write_text('version = 1\n[time]\ncolumn = "t"\n[columns.x]\ncolumn = "x"\n')
    with pytest.raises(UnusableInput, match=r"is no correction; give the correction.toml that"):
        read_correction(path, "Slide")
