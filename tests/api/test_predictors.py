"""Packages from Python: series from a cold start, steps that remember, columns by name."""

import copy
import pickle
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from made_packages import sound
from needs import c_compiler

import wakedeploy as wd
from runtime.loop.safety import far_outside
from runtime.predictor import PackagePredictor
from wakedeploy.core.manifest import ObservationChannel
from wakedeploy.core.observations import out_of_range
from wakedeploy.core.package import Package, write_package


@pytest.fixture(params=["none", "window", "state"])
def predictor(
    request: pytest.FixtureRequest, tiny_package: Callable[[str], Package], tmp_path: Path
) -> wd.Predictor:
    path = tmp_path / "tiny.onnx"
    write_package(sound(tiny_package(request.param)), path)
    return wd.load(path)


def observations(predictor: wd.Predictor, *shape: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    return rng.uniform(-1, 1, (*shape, len(predictor.manifest.observation))).astype(np.float32)


def test_a_series_is_its_steps_from_a_cold_start(predictor: wd.Predictor) -> None:
    series = observations(predictor, 20)
    runner = PackagePredictor(predictor.package)
    stepped = np.stack([runner.step(newest) for newest in series])
    np.testing.assert_array_equal(predictor.predict(series), stepped)
    np.testing.assert_array_equal(predictor.predict(series), stepped)


def test_several_series_are_each_alone(predictor: wd.Predictor) -> None:
    several = observations(predictor, 3, 20)
    alone = np.stack([predictor.predict(series) for series in several])
    assert predictor.predict(several).shape == alone.shape
    np.testing.assert_allclose(predictor.predict(several), alone, rtol=1e-6)


def test_steps_remember_until_they_are_reset_whatever_is_predicted_between(
    predictor: wd.Predictor,
) -> None:
    series = observations(predictor, 20)
    whole = predictor.predict(series)
    first = np.stack([predictor.step(newest) for newest in series[:10]])
    predictor.predict(series)
    rest = np.stack([predictor.step(newest) for newest in series[10:]])
    np.testing.assert_array_equal(np.concatenate([first, rest]), whole)
    predictor.reset()
    np.testing.assert_array_equal(predictor.step(series[0]), whole[0])


def test_a_force_counts_from_the_end_of_the_warm_up_on(predictor: wd.Predictor) -> None:
    series, late = observations(predictor, 9), predictor.manifest.warm_up_steps
    for _ in range(2):
        assert not predictor.ready
        told = []
        for newest in series:
            predictor.step(newest)
            predictor.predict(series)
            told.append(predictor.ready)
        assert told == [step >= late for step in range(1, 10)]
        assert not copy.copy(predictor).ready
        predictor.reset()


def test_a_data_frames_columns_are_found_by_name(predictor: wd.Predictor) -> None:
    pandas = pytest.importorskip("pandas", reason="the extra notebook is not installed")
    series, names = observations(predictor, 5), [c.name for c in predictor.manifest.observation]
    frame = pandas.DataFrame(series, columns=names)
    frame.insert(0, "t_s", np.arange(5.0))
    np.testing.assert_array_equal(predictor.predict(frame), predictor.predict(series))
    with pytest.raises(wd.UnusableInput, match=f"no column {names[0]}"):
        predictor.predict(frame.drop(columns=names[0]))


def test_a_row_of_a_frame_is_stepped_by_its_names(predictor: wd.Predictor) -> None:
    pandas = pytest.importorskip("pandas")
    series = observations(predictor, 6)
    names = [channel.name for channel in predictor.manifest.observation]
    frame = pandas.DataFrame(series, columns=names).assign(t_s=0.0)[["t_s", *reversed(names)]]
    stepped = [predictor.step(row) for _, row in frame.iterrows()]
    np.testing.assert_array_equal(np.stack(stepped), predictor.predict(series))
    predictor.reset()
    first = predictor.step(pandas.Series(series[0]))  # without names it is in order
    np.testing.assert_array_equal(first, stepped[0])
    with pytest.raises(
        wd.UnusableInput, match=f"The observation has no {names[1]}; give {names[0]}"
    ):
        predictor.step(frame.iloc[0][["t_s", names[0]]])


def test_a_tuple_with_names_is_stepped_by_them(predictor: wd.Predictor) -> None:
    pandas = pytest.importorskip("pandas")
    series = observations(predictor, 6)
    names = [channel.name for channel in predictor.manifest.observation]
    frame = pandas.DataFrame(series, columns=names)[[*reversed(names)]]
    told = predictor.predict(series)
    for has_index in (False, True):
        stepped = [predictor.step(row) for row in frame.itertuples(index=has_index)]
        np.testing.assert_array_equal(np.stack(stepped), told)
        predictor.reset()
    (first, *_) = pandas.DataFrame(series).itertuples(index=False)  # without names it is in order
    np.testing.assert_array_equal(predictor.step(first), told[0])
    (first, *_) = frame.drop(columns=names[0]).itertuples(index=False)
    with pytest.raises(wd.UnusableInput, match=f"^The observation has no {names[0]}; give"):
        predictor.step(first)


def test_a_dict_is_taken_by_its_names(predictor: wd.Predictor) -> None:
    series = observations(predictor, 6)
    names = [channel.name for channel in predictor.manifest.observation]
    told = predictor.predict(series)
    by_name = {"t_s": np.arange(6.0), names[1]: series[:, 1], names[0]: series[:, 0]}
    np.testing.assert_array_equal(predictor.predict(by_name), told)
    rows = ({name: values[k] for name, values in by_name.items()} for k in range(6))
    np.testing.assert_array_equal([predictor.step(row) for row in rows], told)
    with pytest.raises(wd.UnusableInput, match=f"^The observations have no column {names[0]}"):
        predictor.predict({names[1]: series[:, 1]})
    with pytest.raises(wd.UnusableInput, match=f"^The observation has no {names[0]}; give"):
        predictor.step({names[1]: 1.0})
    with pytest.raises(wd.UnusableInput, match="what is no number"):
        predictor.step({names[0]: "fast", names[1]: 1.0})


def test_what_a_mask_hides_is_no_number(predictor: wd.Predictor) -> None:
    """As netCDF and the mean of a masked array give it; what lies below the mask is a filler."""
    filled = observations(predictor, 9)
    filled[6] = -999.0
    masked = np.ma.masked_equal(filled, -999.0)
    empty = np.where(filled == -999.0, np.nan, filled)
    np.testing.assert_array_equal(predictor.predict(masked), predictor.predict(empty))
    assert np.isfinite(predictor.predict(masked)[:6]).all()
    assert np.isnan(predictor.step(masked[6])).all()
    counts = np.ma.masked_array(np.ones((2, filled.shape[1]), int), [[0, 0], [0, 1]])
    assert np.isnan(predictor.predict(counts)).any(axis=1).tolist() == [False, True]


@pytest.mark.parametrize(
    "copied", [copy.copy, copy.deepcopy, lambda given: pickle.loads(pickle.dumps(given))]
)
def test_a_copy_begins_anew_and_leaves_the_memory_alone(
    predictor: wd.Predictor, copied: Callable[[wd.Predictor], wd.Predictor]
) -> None:
    series = observations(predictor, 8)
    whole = predictor.predict(series)
    np.testing.assert_array_equal([predictor.step(newest) for newest in series[:4]], whole[:4])
    other = copied(predictor)
    np.testing.assert_array_equal([other.step(newest) for newest in series], whole)
    np.testing.assert_array_equal([predictor.step(newest) for newest in series[4:]], whole[4:])


def test_two_columns_of_one_name_are_refused(predictor: wd.Predictor) -> None:
    pandas = pytest.importorskip("pandas")
    names = [channel.name for channel in predictor.manifest.observation]
    frame = pandas.DataFrame(np.zeros((4, len(names) + 1)), columns=[*names, names[0]])
    with pytest.raises(wd.UnusableInput, match=f"^The observation has {names[0]} 2 times; leave"):
        predictor.step(frame.iloc[0])
    with pytest.raises(wd.UnusableInput, match=f"have column {names[0]} 2 times; leave all but"):
        predictor.predict(frame)


def test_nothing_gives_nothing_and_another_shape_is_refused(predictor: wd.Predictor) -> None:
    inputs, outputs = len(predictor.manifest.observation), len(predictor.manifest.force)
    with pytest.raises(wd.UnusableInput, match=rf"shape \({inputs + 1},\)"):
        predictor.step(np.zeros(inputs + 1))
    assert predictor.predict(np.empty((0, inputs))).shape == (0, outputs)
    with pytest.raises(wd.UnusableInput, match=r"give \(T, "):
        predictor.predict(np.zeros((4, inputs + 1)))
    with pytest.raises(wd.UnusableInput, match=r"give \(T, "):
        predictor.predict(np.zeros(inputs))
    with pytest.raises(wd.UnusableInput, match="not an array of numbers"):
        predictor.predict([["fast"] * inputs])


def test_what_is_no_real_number_is_refused_by_series_and_by_step(predictor: wd.Predictor) -> None:
    inputs = len(predictor.manifest.observation)
    for value in ("1.0", None, 1 + 2j, 10**400, np.datetime64("2026-01-01")):
        for row in ([value] * inputs, [value, *[1.0] * (inputs - 1)]):
            with pytest.raises(wd.UnusableInput, match="not an array of numbers"):
                predictor.predict([row])
            with pytest.raises(wd.UnusableInput, match="cannot be used"):
                predictor.step(row)


def test_numbers_that_are_objects_are_numbers(predictor: wd.Predictor) -> None:
    """As rows of a table that also has text are, once that is taken out."""
    series = np.array([[1, np.float32(0.5)], [False, 0.25]], dtype=object)
    forces = predictor.predict([[1.0, 0.5], [0.0, 0.25]])
    np.testing.assert_array_equal(predictor.predict(series), forces)
    np.testing.assert_array_equal(predictor.predict(np.stack([series, series]))[1], forces)
    predictor.reset()
    np.testing.assert_allclose(predictor.step(series[0]), forces[0], rtol=1e-4, atol=1e-6)
    series[1, 1] = None
    with pytest.raises(wd.UnusableInput, match="it holds what is no number"):
        predictor.predict(series)


def test_columns_of_a_frame_may_be_numbers_of_several_kinds(predictor: wd.Predictor) -> None:
    pandas = pytest.importorskip("pandas", reason="the extra notebook is not installed")
    names = [c.name for c in predictor.manifest.observation]
    frame = pandas.DataFrame({names[0]: [True, False], names[1]: [0.5, 0.25]})
    forces = predictor.predict([[1.0, 0.5], [0.0, 0.25]])
    np.testing.assert_array_equal(predictor.predict(frame), forces)
    with pytest.raises(wd.UnusableInput, match="not an array of numbers"):
        predictor.predict(frame.assign(**{names[0]: ["1.0", "0.0"]}))
    assert len(predictor.predict(pandas.DataFrame(columns=names))) == 0


def test_a_frame_whose_index_tells_another_rate_is_warned_of(predictor: wd.Predictor) -> None:
    """The tiny packages step at 32 Hz; one without a memory does not care."""
    pandas = pytest.importorskip("pandas", reason="the extra notebook is not installed")
    names = [channel.name for channel in predictor.manifest.observation]
    series = observations(predictor, 40)

    def at(rate_hz: float) -> list[object]:
        t = np.arange(40) / rate_hz
        dates = pandas.Timestamp("2026-05-04", tz="Europe/Berlin") + pandas.to_timedelta(t, "s")
        return [dates, dates.tz_localize(None), pandas.to_timedelta(t, "s"),
                pandas.Index(t, name="t_s")]  # fmt: skip

    told = predictor.predict(series)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        lost = at(32.1)[1].to_series().reset_index(drop=True)
        lost[[3, 20, 30]] = None
        places = pandas.Index(np.arange(40) / 2.0, name="speed_m_s")
        for index in (None, *at(32.1), pandas.DatetimeIndex(lost), places):
            frame = pandas.DataFrame(series, columns=names, index=index)
            np.testing.assert_array_equal(predictor.predict(frame), told)
    for index in at(100.0):
        frame = pandas.DataFrame(series, columns=names, index=index)
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            predictor.predict(frame)
        said = [str(w.message) for w in heard]
        assert [s.startswith("The rows are 0.01 s apart, 100 Hz, and the") for s in said] == (
            [] if predictor.manifest.memory.kind == "none" else [True]
        )


def test_other_values_than_in_training_are_warned_of_and_named(predictor: wd.Predictor) -> None:
    """The tiny packages saw -1 to 1 m: a twentieth may lie beyond 1.5, not more."""
    series = np.zeros((100, 2), np.float32)
    series[:5, 0] = 1.6
    series[:, 1] = 1.4
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        predictor.predict(series)
        series[5, 0] = 1.6
        predictor.step(series[5])
    with pytest.warns(wd.OutOfRange) as told:
        predictor.predict(series)
    (warning,) = told
    assert "dx_m is 0 to 1.6, in training it was -1 to 1 m: check the unit" in str(warning.message)
    assert "dz_m" not in str(warning.message)
    assert warning.filename == __file__


def test_knots_for_metres_a_second_are_warned_of() -> None:
    """A boat at 0 to 3 m/s, read in knots."""
    speed = (ObservationChannel(name="speed_mps", unit="m/s", min=0.0, max=3.0),)
    mps = 1.5 - 1.5 * np.cos(np.linspace(0.0, 20.0, 400, dtype=np.float32))[:, None]
    assert out_of_range(mps, speed) is None
    assert "check the unit" in out_of_range(mps / 0.5144, speed)


def test_knots_of_either_sign_are_warned_of_and_pass_the_loop() -> None:
    """A carriage at -3 to 3 m/s: one value stops the loop's feedforward, so that it is slower."""
    speed = (ObservationChannel(name="speed_mps", unit="m/s", min=-3.0, max=3.0),)
    knots = (3.0 / 0.5144) * np.sin(np.linspace(0.0, 20.0, 400, dtype=np.float32))[:, None]
    assert "check the unit" in out_of_range(knots, speed)
    assert not any(far_outside(each, np.float32([-3.0]), np.float32([3.0])) for each in knots)


def test_a_channel_that_never_changed_is_told_as_such() -> None:
    """A thousandth of the constant is no news; what is, is no question of a range."""
    gravity = (ObservationChannel(name="g", unit="m/s^2", min=9.81, max=9.81),)
    assert out_of_range(np.full((50, 1), 9.810002, np.float32), gravity) is None
    assert out_of_range(np.full((50, 1), 9.802, np.float32), gravity) is None
    told = out_of_range(np.full((50, 1), 9.79, np.float32), gravity)
    assert told.startswith("g never changed in training (9.81 m/s^2), and is 9.79 to 9.79 here:")
    assert "in training it was" not in told


def test_a_narrow_range_is_shown_with_digits_that_tell_it_apart() -> None:
    pressure = (ObservationChannel(name="p", unit="kPa", min=100.0, max=100.1),)
    assert out_of_range(np.full((50, 1), 100.19, np.float32), pressure) is None
    told = out_of_range(np.full((50, 1), 100.3, np.float32), pressure)
    assert "p is 100.3 to 100.3, in training it was 100 to 100.1 kPa: check the unit." in told


def test_a_pure_number_has_no_unit_in_a_warning() -> None:
    channels = [ObservationChannel(name="u", unit="1", min=-1.0, max=1.0)]
    told = out_of_range(np.full((9, 1), 5.0, np.float32), channels)
    assert told is not None
    assert told.startswith("u is 5 to 5, in training it was -1 to 1: check the unit.")


def test_a_predictor_says_what_it_is(predictor: wd.Predictor) -> None:
    manifest = predictor.manifest
    assert manifest.arch in repr(predictor)
    assert f"{manifest.force[0].name} [{manifest.force[0].unit}]" in repr(predictor)
    assert all(channel.name in predictor._repr_html_() for channel in manifest.observation)


def test_what_is_no_package_is_refused(tmp_path: Path) -> None:
    with pytest.raises(wd.UnusableInput, match=r"nothing\.onnx: cannot be read"):
        wd.load(tmp_path / "nothing.onnx")


@c_compiler
def test_a_package_becomes_c_which_predicts_the_same(
    predictor: wd.Predictor, tmp_path: Path
) -> None:
    folder = tmp_path / "tiny_c"
    made = wd.export(predictor.path, c=folder)
    loaded = wd.load(folder)
    assert (made.path, loaded.manifest) == (folder, predictor.manifest)
    several = observations(predictor, 3, 20)
    forces = predictor.predict(several)
    np.testing.assert_allclose(loaded.predict(several), forces, rtol=1e-5, atol=1e-6)
    stepped = np.stack([loaded.step(newest) for newest in several[1]])
    np.testing.assert_array_equal(stepped, loaded.predict(several[1]))
    loaded.reset()
    np.testing.assert_array_equal(loaded.step(several[1, 0]), stepped[0])
    assert loaded.predict(np.empty((0, several.shape[-1]))).shape == (0, forces.shape[-1])
    checked = loaded.check()
    assert checked.steps >= 3200
    with pytest.raises(wd.UnusableInput, match="is there already; name another folder for the C"):
        wd.export(predictor, c=folder)
    with pytest.raises(wd.UnusableInput, match="is C already"):
        wd.export(loaded, c=tmp_path / "again")


def test_what_c_cannot_be_is_refused_before_anything_is_written(
    tiny_package: Callable[[str], Package], tmp_path: Path
) -> None:
    write_package(tiny_package("state"), tmp_path / "tiny.onnx")
    package, folder = wd.load(tmp_path / "tiny.onnx"), tmp_path / "c"
    refused = {
        "C keeps float32": {"c": folder, "weights": "float64"},
        "a share from 0 to 1": {"c": folder, "tolerance": 2.0},
        "tolerance 'a': a share": {"c": folder, "tolerance": "a"},
        "1st": {"c": folder, "name": "1st"},
        "weights: belongs to C": {"weights": "int8"},
        "is exported already": {},
        "and no out": {"c": folder, "out": tmp_path / "out.onnx"},
    }
    for sentence, asked in refused.items():
        with pytest.raises(wd.UnusableInput, match=sentence):
            wd.export(package, **asked)
    assert [path.name for path in tmp_path.iterdir()] == ["tiny.onnx"]


def test_what_names_no_file_is_no_package() -> None:
    with pytest.raises(wd.UnusableInput, match=r"^None is no path of a package; wd\.export makes"):
        wd.load(None)
