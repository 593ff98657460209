"""FlareDW: how files are cut, and what the logged acceleration is the derivative of."""

import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.quadrotor_files import MASS_KG, read_flights, transport_term
from wakedeploy.domains.quadrotor_label_audit import audit, corrected_label
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import rank
from wakedeploy.gap.systems.domains.quadrotor import QuadrotorModel
from wakedeploy.gap.workflow import concluded

HOVER_RADPS = 379.0


def states(seconds: float = 6.0, *, turning_axes: bool, place: float = 0.0) -> np.ndarray:
    """A vehicle that flies along y at 3 m/s and rolls to and fro; thrust and drag cancel."""
    time_s = np.arange(0.0, seconds, 0.005)
    roll = 0.2 * np.sin(5.0 * time_s)
    rate = 1.0 * np.cos(5.0 * time_s)
    s = np.zeros((len(time_s), 26))
    s[:, 0], s[:, 1], s[:, 4] = place, 3.0 * time_s, 3.0
    s[:, 11], s[:, 12] = roll, rate
    s[:, 18], s[:, 19] = np.cos(roll / 2), np.sin(roll / 2)
    s[:, 22:26] = HOVER_RADPS * np.array([1, 1, -1, -1])
    if turning_axes:  # the derivative of (0, 3, 0) seen from axes that turn about x
        s[:, 8] -= rate * 3.0
    s[:, 6:9] += np.random.default_rng(int(turning_axes)).normal(0, 0.3, (len(s), 3))
    return s


def saved(folder, name, sufferer):
    source = states(len(sufferer) * 0.005, turning_axes=False, place=5.0)
    np.savez(folder / f"{name}.npz", uav_1_states=source, uav_2_states=sufferer)
    return folder


@pytest.mark.parametrize(("turning_axes", "slope"), [(True, -1.0), (False, 0.0)])
def test_the_audit_tells_turning_axes_from_fixed_ones(tmp_path, turning_axes, slope):
    flights = read_flights(saved(tmp_path, "one", states(turning_axes=turning_axes)))
    told = audit(flights)["all"]["acceleration_less_derivative"]
    assert told["slope"] == pytest.approx(slope, abs=0.03)
    assert (told["p_value"] < 0.01) == turning_axes


def test_what_turning_axes_keep_back_is_omega_times_v(tmp_path):
    s = states(turning_axes=False)
    by_hand = np.cross(np.array([s[110:131, 12].mean(), 0, 0]), [0, 3.0, 0])
    assert transport_term(s)[120] == pytest.approx(by_hand, abs=0.05)
    mended, plain = (
        read_flights(saved(tmp_path, "one", states(turning_axes=t)))[0] for t in (True, False)
    )
    assert corrected_label(mended)[:, 2].std() < 1.2 * plain.label[:, 2].std()
    assert mended.label[:, 2].std() > 2.0 * MASS_KG


def test_jumps_start_flights_and_crashes_are_left_out(tmp_path):
    s = states(turning_axes=False)
    s[400:, 0] += 1.0
    s[800:, 0] += 1.0
    s[900:, 11] = 0.9
    flights = read_flights(saved(tmp_path, "one", s))
    assert [len(f.label) for f in flights] == [400, 400]


def test_a_file_without_states_is_refused_by_key(tmp_path):
    np.savez(tmp_path / "other.npz", uav_1_states=states(turning_axes=False))
    with pytest.raises(UnusableInput, match="uav_2_states: is missing"):
        read_flights(tmp_path)


def test_quaternions_that_are_none_are_refused(tmp_path):
    still = np.zeros((300, 26))
    np.savez(tmp_path / "other.npz", uav_1_states=still, uav_2_states=still)
    with pytest.raises(UnusableInput, match="no unit quaternions"):
        read_flights(tmp_path)


def test_the_label_is_the_authors(recordings):
    folder = recordings("quadrotor")
    path = next(folder.rglob("*speeds_05_20/*1_iteration.npz"))
    with np.load(path) as archive:
        theirs = archive["dw_forces"][:, 2]
    (flight,) = (f for f in read_flights(path.parent) if path.stem in f.name)
    assert flight.label[:, 2] == pytest.approx(theirs, abs=1e-9)


@pytest.mark.whole
def test_the_recorded_acceleration_is_that_of_turning_axes(recordings):
    told = audit(read_flights(recordings("quadrotor")))["all"]
    explained = told["acceleration_less_derivative"]
    assert explained["slope"] == pytest.approx(-1.0, abs=0.02)
    assert explained["rms_left_mps2"] < 0.1 * explained["rms_mps2"]
    assert told["far_corrected_n"]["rms"][2] < 0.4 * told["far_label_n"]["rms"][2]


def test_far_from_any_wake_the_turning_axes_are_named_first(recordings):
    flights = [f for f in read_flights(recordings("quadrotor")) if "_2005it_" in f.name]
    model = QuadrotorModel(tuple(flights), beyond_m=2.0)
    base = fit(model, (), range(model.episodes))
    best = rank(model, base, ("thrust-slope", "rotating-frame", "climb-drag"))[0]
    assert best.name == "rotating-frame"
    assert best.fit.value("rotating-frame.share") == pytest.approx(1.0, abs=0.15)


@pytest.mark.slow
def test_what_is_named_far_from_any_wake_has_intervals_without_nothing(recordings):
    """As they are told: wider than the likelihood's, for residuals that are not white."""
    told = concluded(QuadrotorModel(read_flights(recordings("quadrotor")), beyond_m=2.0))
    assert {e.name for e in told.effects} >= {"rotating-frame", "body-drag"}
    for effect in told.effects:
        assert any(not size.low <= 0.0 <= size.high for size in effect.parameters.values()), effect
