"""Reference flights of a simulated gantry whose thrust and bias differ, one of them oddly."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from wakedeploy.cli import main
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Effect, EffectParameter
from wakedeploy.domains.gantry import record
from wakedeploy.gap.systems.gantry.reference.learning import LOOSE, learn, odd_flights
from wakedeploy.gap.systems.gantry.varying import varying
from wakedeploy.physics.constants import with_constants
from wakedeploy.rig.file import default_rig, read_rig

SHARES = np.array([1.015, 0.985, 1.005, 0.995, 1.01])
ODD, ODD_M = 2, 0.04


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Five flights of 10 s, their thrust off by these shares, the third with a bias of 40 mm."""
    folder, rig = tmp_path_factory.mktemp("ordinary"), default_rig()
    rig.write(folder / "rig.toml")
    for i, share in enumerate(SHARES):
        size = EffectParameter(value=ODD_M if i == ODD else 0.0, unit="m")
        bias = Effect(name="range-bias", parameters={"bias_m": size})
        truth = with_constants(rig, {"thrust.sufferer.scale": float(share)})
        truth = truth.model_copy(update={"effect": (bias,)})
        log = record(truth, seconds=10.0, seed=40 + i, model_rig=rig).without_truth()
        log.write_mcap(folder / f"flight{i}.mcap")
    return folder


@pytest.mark.slow
def test_what_differs_and_which_flight_is_odd_is_in_the_new_rig_file(logs, tmp_path) -> None:
    measured = [word for i in range(5) for word in ("--measured", str(logs / f"flight{i}.mcap"))]
    asked = ["gap", "reference", "--rig", str(logs / "rig.toml"), *measured]
    done = CliRunner().invoke(main, [*asked, "--out", str(tmp_path)])
    assert done.exit_code == 0, done.output
    told = json.loads((tmp_path / "reference.json").read_text())
    (odd,) = told["odd"]
    assert odd["flight"].endswith(f"flight{ODD}.mcap")
    assert odd["away"] == pytest.approx(ODD_M, abs=0.004)
    assert "flight2.mcap differs from the others" in done.output
    thrust = next(o for o in told["repeatability"] if o["quantity"] == "thrust.sufferer.scale")
    true = np.delete(SHARES, ODD).std(ddof=1)
    assert thrust["sd"] == pytest.approx(true, rel=0.3)
    assert thrust["low"] <= true <= thrust["high"]
    learned = read_rig(tmp_path / "rig.toml")
    assert learned.repeatability.thrust == pytest.approx(thrust["sd"])
    assert learned.discrepancy.fitted


def test_three_flights_do_not_tell_which_is_odd() -> None:
    with pytest.raises(UnusableInput, match="3 reference flights"):
        learn(default_rig(), [None, None, None])


def test_flights_are_called_odd_one_after_another_as_long_as_enough_are_left() -> None:
    quantities = varying(default_rig().model_copy(update={"repeatability": LOOSE}))
    rng = np.random.default_rng(5)
    told = [{q.name: (float(rng.standard_normal()), 0.1) for q in quantities} for _ in range(8)]
    assert odd_flights(quantities, told) == ()
    told[1]["range.bias_m"] = (40.0, 0.1)
    told[6]["battery-sag"] = (-60.0, 0.1)
    assert {o.flight for o in odd_flights(quantities, told)} == {1, 6}
