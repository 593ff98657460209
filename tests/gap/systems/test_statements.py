"""What a system states is looked at before anything is computed with it, also by `simulate`."""

import numpy as np
import pytest

from wakedeploy import Constant, Input, Output, Port, System
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.gap.systems.checks import checked
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.sensitivity import column_notes


class Tank(System):
    rate_hz = 20.0
    inputs = [Input("valve", "1")]
    states = {"tank_pa": "Pa"}
    outputs = [Output("tank_pa", "Pa", noise=100.0)]
    constants = [Constant("fill_pa_per_s", 5e3, spread=100.0), Constant("leak_per_s", 0.05)]
    ports = [Port.input("valve"), Port.force("tank_pa")]

    def derivative(self, state, inputs, c):
        return {"tank_pa": c.fill_pa_per_s * inputs.valve - c.leak_per_s * state.tank_pa}


def _log():
    valve = np.repeat(np.random.default_rng(0).uniform(0.0, 1.0, 20), 20)
    columns = {"valve": valve, "tank_pa": 1e3 * np.cumsum(valve)}
    return Recording("bench", np.arange(400) / 20.0, columns)


def _with(**changes):
    return type("Tank", (Tank,), changes)()


def _leak(**form):
    return [Port.custom("leak", lambda t, state, u, p: {"tank_pa": -p.size_pa_per_s}, **form)]


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"states": ["tank_pa"]}, r"states is \['tank_pa'\]; give the unit of each by its name"),
        ({"states": {"tank_pa": 1}}, "state 'tank_pa' has the unit 1, which is not known"),
        ({"inputs": Input("valve", "1")}, r"inputs is Input.*give a list, as \[Input\(name"),
        ({"outputs": Output("tank_pa", "Pa")}, "outputs is Output.*give a list"),
        ({"constants": {"leak_per_s": 0.05}}, "constants is {.*give a list, as .Constant"),
        ({"ports": Port.input("valve")}, r"ports is Port.*give a list, as \[Port.input\(name\)"),
        ({"ports": ["valve"]}, "ports has 'valve'; write Port.input"),
        ({"inputs": [Input(3, "1")]}, "3 is no name"),
        ({"inputs": [Input("valve", None)]}, "input 'valve' has the unit None"),
        ({"inputs": [Input("valve", "1", hold="no")]}, "'no', not step, linear or bandlimited"),
        ({"outputs": [Output("tank_pa", "Pa")] * 2}, "'tank_pa' is stated twice"),
        ({"rate_hz": float("nan")}, "rate_hz is nan; give samples a second"),
        ({"forecast_s": -1.0}, r"forecast_s is -1\.0; give seconds above 0"),
        ({"forecast_s": "1 s"}, "forecast_s is '1 s'; give seconds above 0"),
        ({"outlier_share": 1}, r"outlier_share is 1; give a share .*below 0\.5"),
        ({"process_noise": 0.1}, r"process_noise is 0\.1; give a size by the name of each state"),
        ({"process_noise": {"tank_pa": "low"}}, "process_noise of 'tank_pa' is 'low'; give a num"),
        ({"start_spread": {"tank_pa": -3.0}}, r"start_spread of 'tank_pa' is -3\.0; give a num"),
        ({"start_spread": {"tnk_pa": 3.0}}, "start_spread names 'tnk_pa', .*there are: tank_pa"),
        ({"ports": _leak(parameters={"size": 0.1})}, r"'size' of the effect 'leak' is 0\.1; give"),
        ({"ports": _leak(parameters={"size": ("Paa", 0.1)})}, "'size' .* unit 'Paa', .* not known"),
    ],
)
def test_a_replay_is_refused_for_what_does_not_fit(changes, said):
    with pytest.raises(UnusableInput, match=f"^Tank.*{said}"):
        _with(**changes).simulate(_log())


def test_an_effect_of_one_s_own_has_its_parameters_by_name():
    with pytest.raises(UnusableInput, match=r"'leak' has the parameters .*by name, as"):
        _leak(parameters=["size"])


def test_a_single_kind_may_stand_without_a_list():
    for port in (Port.input("valve", kinds="lag"), Port.force("tank_pa", kinds="offset")):
        (effect,) = LogModel(_with(ports=[port]), [_log()]).library
        assert effect in ("lag@valve", "offset@tank_pa")


def test_a_mistyped_kind_is_answered_with_its_port_and_the_one_that_is_near():
    system = _with(ports=[Port.input("valve", kinds=["deadband"])])
    said = "'deadband' is no kind of the input port 'valve'; did you mean dead-band"
    with pytest.raises(UnusableInput, match=said):
        LogModel(system, [_log()])


def test_a_look_says_that_no_effect_can_be_asked_for():
    """The attribute may be mistyped: then a table of constants alone looked complete."""
    model = LogModel(_with(ports=[]), [_log()])
    assert any("states no ports" in note for note in column_notes(model))


def test_a_number_in_an_array_of_no_dimension_is_one_wherever_a_number_is_stated() -> None:
    """Constants had taken one, and a share of outliers was said to be none."""
    plain = {"rate_hz": 20.0, "outlier_share": 0.01, "forecast_s": 0.5}
    sizes = {"process_noise": {"tank_pa": 10.0}, "start_spread": {"tank_pa": 5.0}}
    arrays = {name: np.array(value) for name, value in plain.items()}
    arrays |= {n: {"tank_pa": np.array(v["tank_pa"])} for n, v in sizes.items()}
    models = [LogModel(checked(_with(**stated)), [_log()]) for stated in (plain | sizes, arrays)]
    scores = [m.score((), np.array([f.neutral for f in m.free(())]), 0) for m in models]
    assert np.array_equal(scores[0].log_density, scores[1].log_density)
    assert models[0].horizon == models[1].horizon
    with pytest.raises(UnusableInput, match="outlier_share is array"):
        checked(_with(outlier_share=np.array([0.01])))


def test_a_replay_looks_at_what_was_changed_since_the_last_one_and_changes_nothing() -> None:
    """A rate below 0 after a first replay ended in an error of numpy."""
    tank = Tank()
    assert np.isfinite(tank.simulate(_log())["tank_pa"]).all()
    assert "constants" not in vars(tank)
    tank.rate_hz = -3.0
    with pytest.raises(UnusableInput, match=r"rate_hz is -3\.0; give samples a second"):
        tank.simulate(_log())


@pytest.mark.parametrize(
    ("given", "meant"), [("forcast_s", "forecast_s"), ("outlier_shares", "outlier_share")]
)
def test_a_mistyped_attribute_is_named_with_the_one_that_is_meant(given, meant):
    """It was passed over in silence, and the default taken."""
    with pytest.raises(UnusableInput, match=f"{given} is nothing.*did you mean `{meant}`"):
        checked(_with(**{given: 0.1}))
    own = {f"_{given}": 0.1, "step_m": 0.05, "length_m": 2.0, "forecasts": lambda self: 1}
    checked(_with(**own))
    checked(_with(**{given: 0.1, meant: 0.2}))
