"""Arguments that no function can use: each is one sentence with the argument, before any work."""

import errno
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from small_tune import small_set

import wakedeploy as wd
from wakedeploy.api.arguments import _names, in_python

NAN = math.nan
TRAINING = {
    "seeds": [0, -1, 1.5, NAN, True, "2", None],
    "threads": [0, NAN],
    "epochs": [0, -3, NAN],
}
TRAINING |= {"lead_s": [-0.1, NAN, math.inf, "0"], "learning_rate": [0.0, -1.0, NAN]}
TRAINING |= {"arch": [[], (), "", [3]], "device": ["gpu"]}
TUNING = {"trials": [0, -1, NAN, 2.5], "workers": [0, -1], "epochs": [0, NAN], "budget": [0, -1]}
TUNING |= {"seed": [-1, NAN], "lead_s": [-1.0, NAN], "pruner": ["", "best"], "device": ["gpu"]}
TUNING |= {
    "dimensions": ["hiden=3", [""], [3]],
    "starts": ["nowhere.toml", [3]],
    "objective": ["", "f"],
}


def each(given: dict[str, list[object]]) -> list[tuple[str, object]]:
    return [(name, value) for name, values in given.items() for value in values]


def refused(call: Callable[[], object], names: str) -> None:
    with pytest.raises(wd.UnusableInput, match=names) as told:
        call()
    sentence = str(told.value)
    assert "\n" not in sentence
    assert "--" not in sentence
    assert sentence.endswith(".")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("set")
    small_set().write(path)
    return path


@pytest.mark.parametrize(("name", "value"), each(TRAINING))
def test_what_nothing_can_be_trained_with_is_named(
    name: str, value: object, folder: Path, tmp_path: Path
) -> None:
    given = {"arch": "agile-mlp", "epochs": 1, "out": tmp_path / "runs", "pictures": False}
    refused(lambda: wd.train(folder, **given | {name: value}), name.split("_")[0])
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize(("name", "value"), each(TUNING))
def test_what_nothing_can_be_searched_with_is_named(
    name: str, value: object, folder: Path, tmp_path: Path
) -> None:
    given = {"trials": 1, "epochs": 1, "out": tmp_path / "tuned"}
    refused(lambda: wd.tune(folder, "gru", **given | {name: value}), name.split("_")[0])
    assert not (tmp_path / "tuned").exists()


def test_what_no_set_can_be_made_with_is_named(tmp_path: Path) -> None:
    for name, value in each({"minutes": [0, -1, NAN, math.inf, "1"], "seed": [-1, NAN]}):
        refused(lambda n=name, v=value: wd.make_set("ship", **{"minutes": 1, n: v}), name)
    refused(lambda: wd.make_set("ship", minutes=1, level="fast"), "level = 'fast' has to be")
    refused(lambda: wd.make_set("downwash", minutes=1, spread=NAN), "spread = nan has to be")
    log = tmp_path / "a.csv"
    log.write_text("t,x\n0,1\n")
    refused(lambda: wd.guess_columns([]), "give a log")
    refused(lambda: wd.guess_columns([log, log]), "give a log")


def test_what_nothing_can_be_flown_or_compared_with_is_named(tmp_path: Path) -> None:
    for name, value in each({"flights": [0, -1, 1.5, NAN], "workers": [0, NAN], "seconds": [NAN]}):
        refused(lambda n=name, v=value: wd.fly(**{n: v}), f"{name} is ")
    rig = tmp_path / "rig.toml"
    wd.default_rig().write(rig)
    for name, value in each({"workers": [0, -1], "retrain_minutes": [0, NAN]}):
        given = {name: value}
        refused(lambda g=given: wd.close_gap(rig, ["a.mcap"], tmp_path / "gap", **g), f"{name} is ")
    refused(lambda: wd.close_gap(rig, [], tmp_path / "gap"), "measured is empty")
    assert not (tmp_path / "gap").exists()


RIG = wd.default_rig()
NO_PATHS: tuple[Callable[[object], object], ...] = (
    wd.EpisodeSet.read,
    wd.Flight.read,
    wd.Gap.read,
    wd.read_rig,
    RIG.write,
    small_set().write,
    lambda value: wd.evaluate("runs", value),
    lambda value: wd.train(value, "gru"),
    lambda value: wd.train(small_set(), "gru", out=value),
    lambda value: wd.tune(small_set(), "gru", out=value),
    lambda value: wd.tune(value, "gru"),
    lambda value: wd.export(value),
    lambda value: wd.import_set("fish", value),
    lambda value: wd.import_table(value, "columns.toml"),
    lambda value: wd.read_log(value, "columns.toml"),
    lambda value: wd.guess_columns(value),
    lambda value: wd.close_gap("rig.toml", ["a.mcap"], value),
    lambda value: wd.fly(rig=value),
    lambda value: wd.fly(plant_rig=value),
    lambda value: wd.fly(log=value),
    lambda value: wd.fly(reference=value),
    lambda value: wd.fly(arm_file=value),
)


@pytest.mark.parametrize("call", NO_PATHS)
@pytest.mark.parametrize("value", [3, b"here", ""])
def test_what_is_no_path_is_named(
    call: Callable[[object], object], value: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    refused(lambda: call(value), r"^\w+ is (3|b'here'|''): give a path, as text or as a Path\.$")
    assert not list(tmp_path.iterdir())


def test_a_tilde_is_the_home_folder_and_no_folder_of_that_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home, here = tmp_path / "home", tmp_path / "here"
    for folder in (home / "rigs", here):
        folder.mkdir(parents=True)
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.chdir(here)
    RIG.write("~/rigs/rig.toml")
    small_set().write(Path("~/set"))
    assert wd.EpisodeSet.read("~/set").sha256 == small_set().sha256
    assert wd.read_rig("~/rigs/rig.toml") == RIG
    with pytest.raises(wd.UnusableInput, match=f"^{home}/none.onnx: cannot be read"):
        wd.load("~/none.onnx")
    assert list(here.iterdir()) == []


def test_a_place_where_no_file_can_be_written_is_told_as_a_command_tells_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "sets").mkdir()
    (tmp_path / "gru.csv").write_text("t\n")
    refused(lambda: RIG.write("sets"), r"^sets: Is a directory\.$")
    refused(lambda: RIG.write("gru.csv/rig.toml"), r"^gru\.csv: File exists\.$")
    given = {"arch": "agile-mlp", "epochs": 1, "pictures": False}
    refused(lambda: wd.train(small_set(640), **given, out="gru.csv"), "Not a directory")
    data = small_set(640)
    runs = wd.train(data, **given)
    refused(lambda: wd.export(runs, "sets", data=data), r"^sets: Is a directory\.$")
    refused(lambda: wd.export(runs, data=data, c=""), "c is '': give a path")
    assert not list((tmp_path / "sets").iterdir())


def test_a_full_disk_is_the_librarys_own_error_and_a_broken_pipe_stays_one() -> None:
    @in_python
    def fail(error: OSError) -> None:
        raise error

    with pytest.raises(wd.WakedeployError, match=r"^a: No space left on device; free some space"):
        fail(OSError(errno.ENOSPC, "No space left on device", "a"))
    for kept in (BrokenPipeError(errno.EPIPE, "Broken pipe"), OSError("of another library")):
        with pytest.raises(type(kept)):
            fail(kept)


def raised_by_hand(*_: object) -> None:
    raise FileNotFoundError(errno.ENOENT, "No such file or directory", "mine.txt")


OWN_FUNCTIONS: list[Callable[[Path], object]] = [
    lambda folder: wd.make_set("ship", minutes=0.2, progress=raised_by_hand),
    lambda folder: wd.train(folder, "gru", epochs=1, progress=raised_by_hand),
    lambda folder: wd.tune(folder, "gru", trials=1, out=folder / "t", on_begun=raised_by_hand),
    lambda folder: wd.fly(seconds=1.0, tell=raised_by_hand),
    lambda folder: wd.fly(seconds=4.0, progress=raised_by_hand),
]


@pytest.mark.parametrize("call", OWN_FUNCTIONS)
def test_what_a_persons_own_function_raises_comes_out_as_it_was(
    call: Callable[[Path], object], folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("runtime.run.SHOW_PERIOD_S", 0.01)
    with pytest.raises(FileNotFoundError) as told:
        call(folder)
    assert told.value.filename == "mine.txt"


def test_a_persons_own_sentence_is_not_reworded() -> None:
    def raising(*_: object) -> None:
        raise wd.UnusableInput("mine: give --seed and --minutes")

    with pytest.raises(wd.UnusableInput, match=r"^mine: give --seed and --minutes$"):
        wd.make_set("ship", minutes=0.2, progress=raising)


def test_a_reference_to_fly_is_a_path_as_text_too(tmp_path: Path) -> None:
    rows = ("0,0,0,1000", "1,0,0,1000", "4,0.4,0,1000", "7,0,0,1000", "8,0,0,1000")
    csv = tmp_path / "up.csv"
    csv.write_text("\n".join(("t_s,z_m,x_m,source_us", *rows)) + "\n")
    flight = wd.fly(reference=str(csv))
    assert max(flight["z_ref_m"]) == pytest.approx(0.4, abs=0.02)


def test_what_is_of_another_kind_is_named(folder: Path) -> None:
    refused(lambda: wd.train(folder, 3), "arch has 3")
    refused(lambda: wd.train(folder, "gru", hyper=3), "hyper is 3")
    refused(
        lambda: wd.tune(folder, ["gru", "tcn"]), r"arch is \['gru', 'tcn'\]: give the name of one"
    )
    for name in ("preset", "device"):
        refused(lambda n=name: wd.train(folder, "gru", **{n: 3}), f"^{name} is 3: give text")
    refused(lambda: wd.train(folder, "gru", hyper={3: 3}), "^hyper has 3: give {'ARCH.NAME'")
    refused(
        lambda: wd.train(folder, "gru", tracker="tensorbord"), "^tracker is .*: give tensorboard"
    )
    refused(lambda: wd.tune(folder, "grru"), "'grru' is no architecture; did you mean gru")
    refused(lambda: wd.tune(folder, "gru", objective=3), "^objective is 3: give text")
    refused(lambda: wd.guess_columns(folder / "dataset.json", 3), "^system is 3: give a class")
    refused(lambda: wd.make_set(3), "'3' is no domain")
    for strange in (3, [3], b"gru.onnx", [None]):
        refused(lambda s=strange: wd.make_set("gantry", packages=s), "^packages is .*: give a path")
    with pytest.raises(wd.UnusableInput, match=r"^gone\.onnx: "):  # one path, and no letters
        wd.make_set("gantry", minutes=1, packages="gone.onnx")
    refused(lambda: wd.close_gap("rig.toml", 3, "gap"), "measured is 3")
    refused(lambda: RIG.changed(sufferer=0.5), "sufferer is 0.5: give its constants by name")
    refused(lambda: wd.with_effect(RIG, "ground-effect", gain="a", height_m=0.2), "gain is 'a'")


SWITCHES = ("wall_clock", "firmware", "wake_off", "watch_gap", "allow_lead_mismatch", "realtime")


def test_what_is_no_switch_no_text_and_cannot_be_called_is_named(tmp_path: Path) -> None:
    for name in (*SWITCHES, "record"):
        refused(lambda n=name: wd.fly(**{n: "no"}), rf"^{name} is 'no': give True or False\.$")
        refused(lambda n=name: wd.fly(**{n: 3}), rf"^{name} is 3: give True or False\.$")
    refused(lambda: wd.fly(record=None), "^record is None: give True or False")
    for name in ("progress", "tell", "warn"):
        refused(lambda n=name: wd.fly(**{n: 3}), rf"^{name} is 3: give a function to call\.$")
    refused(lambda: wd.fly(progress=None), "^progress is None")
    refused(lambda: wd.fly(port=3), r"^port is 3: give a path, as text or as a Path\.$")
    refused(lambda: wd.fly(port=Path("gone/uno")), r"gone/uno")
    refused(lambda: wd.fly(hooks=3), r"^hooks is 3: give text\.$")
    refused(lambda: wd.fly(live=3), r"^live is 3: give what wakedeploy\.live makes, or None\.$")
    refused(lambda: wd.fly(plant_seed="a"), "^plant_seed is 'a': give a whole number from 0 on")
    given = {"arch": "agile-mlp", "epochs": 1, "out": tmp_path / "runs"}
    refused(
        lambda: wd.train(small_set(), **given, fresh="no"), "^fresh is 'no': give True or False"
    )
    refused(lambda: wd.train(small_set(), **given, progress=3), "^progress is 3: give a function")
    assert not (tmp_path / "runs").exists()


def test_switches_may_be_numpys(tmp_path: Path) -> None:
    flown = wd.fly(seconds=1.0, record=np.bool_(False), warn=None, realtime=None, hooks=None)
    assert flown.ended == "whole"


def test_a_keyword_that_is_not_there_is_never_ignored(tmp_path: Path) -> None:
    for call, told in (
        (lambda: wd.fly(second=6.0), r"^fly\(\) got .* 'second'; did you mean seconds\?$"),
        (lambda: wd.fly(spacer_m=0.1), r"^fly\(\) got an unexpected keyword argument 'spacer_m'$"),
        (lambda: wd.fly(place={}), r"^fly\(\) got an unexpected keyword argument 'place'"),
        (lambda: wd.export("a.onnx", c=tmp_path / "c", nam="w"), r"'nam'; did you mean name\?$"),
        (lambda: wd.train("a", epoch=3), r"^train\(\) got .*; did you mean epochs\?$"),
    ):
        with pytest.raises(TypeError, match=told):
            call()


def test_one_observation_is_stepped_and_a_batch_refused(folder: Path, tmp_path: Path) -> None:
    data = small_set(640)
    runs = wd.train(data, "agile-mlp", epochs=1, out=tmp_path / "runs", pictures=False)
    predictor = wd.export(runs, tmp_path / "p.onnx", data=data)
    assert predictor.step(np.zeros(1)).shape == (1,)
    for shape in ((1, 1), (2, 1), (1, 1, 1), (2,), ()):
        refused(lambda s=shape: predictor.step(np.zeros(s)), r"shape \(")


def test_options_are_arguments_in_python_and_commands_stay() -> None:
    @in_python
    def fail(sentence: str, out: str = "", fresh: bool = False, lead_s: float = 0.0) -> None:
        raise wd.CheckFailed(sentence)

    assert {"out", "reference", "allow_lead_mismatch"} - _names(wd.fly) == {"out"}
    for said, told in (
        ("a is there; choose another --out.", "a is there; choose another out."),
        ("choose --out (out=), or --fresh (fresh=True).", "choose out=, or fresh=True."),
        ("--lead 0.2: too far.", "lead_s 0.2: too far."),
        ("run `wakedeploy train --out runs`.", "run `wakedeploy train --out runs`."),
        (
            "begin with: wakedeploy train --out a; or out.",
            "begin with: wakedeploy train --out a; or out.",
        ),
        ("convert it by x --format csv.", "convert it by x --format csv."),
        ("--data FOLDER (in Python, data=…).", "data=…."),
    ):
        with pytest.raises(wd.CheckFailed) as raised:
            fail(said)
        assert str(raised.value) == told
