"""What is exported computes, or holds, the same as what it was exported from."""

import importlib.util
import json
import re
import subprocess
import sys

import needs
import numpy as np
import pytest
import scipy.io
from click.testing import CliRunner

from wakedeploy.cli.gap_export import export as command
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Effect, EffectParameter
from wakedeploy.core.runlog import read_run_log
from wakedeploy.core.tables import matlab_names, write_log, write_set
from wakedeploy.domains.gantry import record
from wakedeploy.gap.model_export.effects import _Plain
from wakedeploy.gap.model_export.files import export_rig, matlab_script
from wakedeploy.gap.model_export.matlab import function
from wakedeploy.physics.constants import constants_of
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.physics.effects.chain import Chain
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig.file import default_rig

# Without chance and without the way of a reading: what is left is the model.
RIG = default_rig().changed(
    disturbance={"turbulence_fraction": 0.0, "outlier_probability": 0.0},
    range_sensor={"noise_m": 0.0, "resolution_m": 0.0},
    latency={"round_trip_s": 0.0},
)
SEED = 3
SYMBOLIC = Effect(
    name="symbolic-force",
    expression="c*sin(3*time_s)*max(z_m, 0.1)**2 - 0.02*abs(vz_mps)/(1 + sqrt(source_n))",
    parameters={"c": EffectParameter(value=0.3, unit="N/m^2")},
)


def entry(name):
    """An effect one prior scale away from neutral."""
    constants = constants_of(RIG)
    parameters = {}
    for one in LIBRARY[name].parameters:
        neutral = constants[one.constant] if one.constant else one.neutral
        value = min(neutral + one.scale, one.high)
        parameters[one.name] = EffectParameter(value=value, unit=one.unit)
    return Effect(name=name, parameters=parameters)


def with_effects(*entries):
    return RIG.model_copy(update={"effect": entries})


def flown(rig, steps=512):
    """Inputs of a lively flight, and what the plant makes of them."""
    t_s = np.arange(steps) / 256.0
    sufferer_us = 1745.0 + 40.0 * np.sin(2.2 * t_s) + 15.0 * np.sign(np.sin(6.9 * t_s))
    sufferer_us[t_s < 0.2] = 1000.0
    source_us = 1450.0 + 250.0 * np.sign(np.sin(4.4 * t_s)) + 100.0 * np.sin(5.0 * t_s)
    plant, rows = GantryPlant(rig, seed=SEED), []
    for k in range(steps):
        before = (plant.x_m, plant.z_m, plant.vz_mps)
        plant.step(source_us[k], sufferer_us[k], 0.25 * np.sin(2.5 * t_s[k]))
        force_n = plant.wake_force_n
        thrusts = (plant.source_thrust_n, plant.sufferer_thrust_n)
        rows.append((*before, plant.range_sample().range_m, *thrusts, force_n))
    names = ("x_m", "z_m", "vz_mps", "range_m", "source_n", "sufferer_n", "wake_n")
    truth = dict(zip(names, np.array(rows, dtype=float).T, strict=True))
    return (t_s, source_us, sufferer_us, truth.pop("x_m"), 0.0, *phases(rig)), truth


def phases(rig):
    """When the plant's first servo frame, range sample and new reading come [s]."""
    sensing, _, timing = np.random.SeedSequence([SEED, 0]).spawn(3)
    constants = Chain.of(rig).constants(constants_of(rig))
    frame_s = constants["disturbance.esc_frame_s"]
    sensor = np.random.default_rng(sensing)
    range_s = sensor.uniform(0.0, rig.range_sensor.period_s)
    hold_s = constants["range.hold_s"]
    reading_s = -sensor.uniform(0.0, hold_s) if hold_s > 0.0 else 0.0
    return np.random.default_rng(timing).uniform(0.0, frame_s), range_s, reading_s


def imported(path):
    spec = importlib.util.spec_from_file_location(f"model_{path.parent.name}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def agree(exported, truth):
    for name, expected in truth.items():
        got = np.ravel(exported[name])
        assert np.array_equal(np.isnan(got), np.isnan(expected)), name
        assert np.nanmax(np.abs(got - expected)) <= 1e-9 * np.nanmax(np.abs(expected)), name


@pytest.mark.parametrize("name", [None, *LIBRARY])
def test_the_python_module_moves_as_the_plant_does_under_every_effect(name, tmp_path):
    rig = with_effects(entry(name)) if name else RIG
    inputs, truth = flown(rig)
    assert truth["z_m"].max() > 0.1
    path, _ = export_rig(rig, tmp_path)
    agree(imported(path).simulate(*inputs), truth)


def all_acting():
    """Every effect that does more than replace a constant, and a force without a name."""
    acting = [n for n in LIBRARY if Chain({n: dict.fromkeys(_names(n), 0.0)}).moves]
    return with_effects(*(entry(name) for name in acting), SYMBOLIC)


def _names(effect):
    return [one.name for one in LIBRARY[effect].parameters]


def test_all_effects_together_with_an_expression_stay_in_their_order(tmp_path):
    rig = all_acting()
    assert len(rig.effect) >= 15
    inputs, truth = flown(rig)
    path, _ = export_rig(rig, tmp_path)
    agree(imported(path).simulate(*inputs), truth)
    text = path.read_text()
    assert "SimpleNamespace(c=0.3)" in text
    assert "numpy" in text
    assert "wakedeploy." not in text.split('"""')[2]
    assert {line.split()[1] for line in text.splitlines() if re.match(r"import|from", line)} == {
        "numpy",
        "types",
        "typing",
    }


@needs.octave
def test_octave_computes_what_python_computes(tmp_path):
    rig = all_acting()
    inputs, truth = flown(rig, steps=384)
    path, script = export_rig(rig, tmp_path)
    expected = imported(path).simulate(*inputs)
    agree(expected, truth)
    scipy.io.savemat(tmp_path / "in.mat", {f"a{i}": value for i, value in enumerate(inputs)})
    call = f"r = gantry_model({', '.join(f'a{i}' for i in range(len(inputs)))});"
    text = f"cd('{tmp_path}'); load in.mat; {call} save('-v6', 'out.mat', '-struct', 'r');"
    arguments = ["octave-cli", "--quiet", "--norc", "--eval", text]
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    agree(scipy.io.loadmat(tmp_path / "out.mat"), {k: v for k, v in expected.items() if k != "t_s"})
    assert script.name == "gantry_model.m"


def test_the_script_has_every_function_that_it_calls_and_balanced_blocks():
    script = matlab_script(all_acting())
    code = "\n".join(line.split("%")[0] for line in script.splitlines())
    defined = set(re.findall(r"^function \[?[\w, ]*\]? = (\w+)\(", code, re.MULTILINE))
    assert "gantry_model" in defined
    assert script.startswith("function [out1] = gantry_model(t_s, source_us, sufferer_us, x_m,")
    own = set(re.findall(r"\b([a-z]\w*_\w+)\(", code)) - defined
    arrays = {"z_m", "x_m", "t_s", "vz_mps", "range_m", "source_n", "sufferer_n", "wake_n"}
    assert own <= arrays | {"effect_n", "source_us", "sufferer_us", "curve_us", "curve_n"}
    opened = len(re.findall(r"^\s*(?:function|if|for)\b", code, re.MULTILINE))
    closed = len(re.findall(r"\bend\s*$", code, re.MULTILINE))
    assert opened == closed
    assert "**" not in code
    assert "np." not in code


def test_what_has_no_counterpart_in_matlab_is_named():
    import ast

    tree = ast.parse("def f(x):\n    return [y for y in x]\n").body[0]
    with pytest.raises(UnusableInput, match=r"f: '\[y for y in x\]' has no counterpart"):
        function(tree)
    surplus = ("max(0.0, x, 2.0)", "round(x, 2)", "np.arange(2, 5)", "np.sum(x, 1)")
    for call in (*surplus, "np.hypot(x)"):
        tree = ast.parse(f"def f(x):\n    return {call}\n").body[0]
        with pytest.raises(UnusableInput, match="has no counterpart"):
            function(tree)


def test_an_effect_of_another_module_than_numpy_is_refused():
    """What is exported imports numpy alone, and as np."""
    import ast
    import math

    for known, words in (({"math": math}, "uses 'math'"), ({"numpy": np}, None)):
        (used,) = known
        tree = ast.parse(f"def force_n(self, p, m, s):\n    return {used}.exp(m.z_m)\n").body[0]
        if words is None:
            assert ast.unparse(_Plain("own", known).visit(tree)).endswith("return np.exp(m.z_m)")
            continue
        with pytest.raises(UnusableInput, match=words):
            _Plain("own", known).visit(tree)


# --- logs and sets ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def log_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "flight.mcap"
    record(default_rig(), seconds=6, seed=1).write_mcap(path)
    return path


def test_a_log_as_parquet_holds_every_value_unit_and_metadata(log_file, tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    out = tmp_path / "flight.parquet"
    done = CliRunner().invoke(command, ["--log", str(log_file), "--out", str(out)])
    assert done.exit_code == 0, done.output
    log, table = read_run_log(log_file), parquet.read_table(out)
    assert table.column_names == list(log.columns)
    for name, values in log.columns.items():
        read = table.column(name).to_pylist()
        if values.dtype == object:
            assert read == values.tolist()
        else:
            assert np.array_equal(np.array(read, dtype=float), values, equal_nan=True), name
    assert table.schema.field("tick").type == "int64"
    assert table.schema.field("z_est_m").metadata == {b"unit": b"m"}
    assert table.schema.metadata[b"rig_sha256"].decode() == log.metadata["rig_sha256"]
    assert table.column("round_trip_s").null_count == int(np.isnan(log["round_trip_s"]).sum())


def test_a_log_as_mat_holds_every_value_and_the_units(log_file, tmp_path):
    out = tmp_path / "flight.mat"
    log = read_run_log(log_file)
    write_log(log, out)
    read = scipy.io.loadmat(out, simplify_cells=True)
    for name, values in log.columns.items():
        if values.dtype == object:
            assert [str(v) if len(v) else "" for v in read[name]] == values.tolist()
        else:
            assert np.array_equal(read[name], values, equal_nan=True), name
    assert read["units"]["vz_est_mps"] == "m/s"
    assert read["metadata"]["rig_toml"] == log.metadata["rig_toml"]


def a_set():
    rng = np.random.default_rng(0)

    def episode(name, count):
        arrays = [rng.standard_normal((count, d)).astype(np.float32) for d in (2, 1)]
        extras = {"thrust_after_the_spool_lag_and_all_n": arrays[0][:, :1].copy()}
        return Episode(name, *arrays, extras if name == "one" else {})

    return EpisodeSet(
        domain="gantry",
        rate_hz=32.0,
        observation=(Channel("dx_m", "m"), Channel("source-command", "1")),
        force=(Channel("force_z_n", "N"),),
        window_s=0.5,
        loss_weights=(1.0,),
        split={"one": "train", "two": "test"},
        episodes=(episode("one", 5), episode("two", 3)),
    )


def test_a_set_as_parquet_has_a_row_for_every_sample(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    made, folder, out = a_set(), tmp_path / "set", tmp_path / "set.parquet"
    made.write(folder)
    done = CliRunner().invoke(command, ["--set", str(folder), "--out", str(out)])
    assert done.exit_code == 0, done.output
    table = parquet.read_table(out)
    assert table.column("episode").to_pylist() == ["one"] * 5 + ["two"] * 3
    assert table.column("split").to_pylist() == ["train"] * 5 + ["test"] * 3
    assert table.column("t_s").to_pylist()[5:] == [0.0, 1 / 32, 2 / 32]
    forces = np.concatenate([e.force[:, 0] for e in made.episodes])
    assert np.array_equal(table.column("force_z_n").to_numpy(), forces)
    assert table.schema.field("force_z_n").metadata == {b"unit": b"N"}
    extra = table.column("thrust_after_the_spool_lag_and_all_n").to_numpy()
    assert np.isfinite(extra[:5]).all()
    assert np.isnan(extra[5:]).all()
    assert table.schema.metadata[b"sha256"].decode() == made.sha256


def test_a_set_as_mat_has_a_struct_for_every_episode(tmp_path):
    made, out = a_set(), tmp_path / "set.mat"
    write_set(made, out)
    read = scipy.io.loadmat(out, simplify_cells=True)
    assert [e["name"] for e in read["episodes"]] == ["one", "two"]
    assert np.array_equal(read["episodes"][1]["observation"], made.episodes[1].observation)
    assert read["observation_names"].tolist() == ["dx_m", "source-command"]
    assert all(len(name) <= 31 for name in read["episodes"][0])
    assert json.loads(read["metadata"]["provenance"]) == {}


def test_names_become_short_valid_and_different():
    names = matlab_names(["a-b", "a_b", "9lives", "x" * 40, "x" * 41])
    assert list(names.values()) == ["a_b", "a_b_2", "x9lives", "x" * 31, "x" * 29 + "_2"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--out", "x"], "one of --rig FILE, --log FILE and --set FOLDER"),
        (["--log", "{log}", "--out", "x.txt"], "ends in .csv, .parquet or .mat"),
        (["--log", "missing.mcap", "--out", "x.mat"], "there is no such file in "),
    ],
)
def test_bad_requests_are_one_sentence(arguments, sentence, log_file):
    given = [one.replace("{log}", str(log_file)) for one in arguments]
    done = CliRunner().invoke(command, given)
    assert isinstance(done.exception, UnusableInput)
    assert sentence in str(done.exception)


def test_without_pyarrow_one_sentence_says_what_to_install(log_file, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(UnusableInput, match=r"-m pip install .* '\.\[tables\]'"):
        write_log(read_run_log(log_file), tmp_path / "flight.parquet")


def test_the_command_writes_a_rig_s_model(tmp_path):
    rig_file, out = tmp_path / "rig.toml", tmp_path / "model"
    with_effects(entry("ground-effect")).write(rig_file)
    done = CliRunner().invoke(command, ["--rig", str(rig_file), "--out", str(out)])
    assert done.exit_code == 0, done.output
    assert "ground-effect" in done.output
    assert {path.name for path in out.iterdir()} == {"gantry_model.py", "gantry_model.m"}
