"""The benchmark on recordings: what its judge says, and one small case from end to end."""

import json

import numpy as np
import pytest
from click.testing import CliRunner

from benchmarks.real_systems import __main__ as benchmark
from benchmarks.real_systems.answering import PARTS, recordings_of, system_of
from benchmarks.real_systems.cases import CASES, Added, Case
from benchmarks.real_systems.judge import agreement, judged_left_in, judged_left_out
from benchmarks.results import real_systems
from benchmarks.results.section import Records
from wakedeploy import Constant

SYSTEM = """
from wakedeploy import Constant, Input, Output, Port, System
class Cart(System):
    rate_hz = 50.0
    inputs = [Input("force_n", "N")]
    states = {"speed_mps": "m/s"}
    outputs = [Output("speed_mps", "m/s", noise=1e-3)]
    constants = [Constant("mass_kg", 2.0, spread=0.1)]
    ports = [Port.force("speed_mps", inertia="mass_kg", kinds=["viscous-friction", "offset"])]
    def derivative(self, state, inputs, c):
        return {"speed_mps": inputs.force_n / c.mass_kg}
"""
COLUMNS = """
version = 1
[time]
rate_hz = 50.0
[columns.force_n]
column = "force"
role = "input"
unit = "N"
[columns.speed_mps]
column = "speed"
role = "output"
unit = "m/s"
"""
FRICTION = "viscous-friction@speed_mps"


@pytest.fixture
def cart(tmp_path):
    """A cart of 2 kg with viscous friction of 3 N s/m, and a case that does not know it."""
    rng = np.random.default_rng(0)
    force = np.repeat(10.0 * rng.standard_normal(50), 16)
    speed = np.zeros(len(force))
    keep = np.exp(-1.5 / 50.0)
    for k in range(1, len(force)):
        speed[k] = keep * speed[k - 1] + (1.0 - keep) * force[k - 1] / 3.0
    speed += 1e-3 * rng.standard_normal(len(force))
    table = np.column_stack([force, speed])
    np.savetxt(tmp_path / "log.csv", table, delimiter=",", header="force,speed", comments="")
    (tmp_path / "cart.py").write_text(SYSTEM)
    (tmp_path / "cart.toml").write_text(COLUMNS)
    built_in = Added(
        (Constant("friction", 1.0, float("inf")),),
        lambda state, inputs, c: {"speed_mps": -c.friction * state.speed_mps / c.mass_kg},
    )
    places = (str(tmp_path / name) for name in ("cart.py", "cart.toml"))
    files = (str(tmp_path / "log.csv"),)
    return Case("cart", *places, files, (FRICTION,), "made here", added=built_in)


@pytest.mark.slow
def test_a_small_case_is_asked_and_judged(cart, tmp_path, monkeypatch):
    monkeypatch.setattr(benchmark, "CASES", (cart,))
    record = tmp_path / "real-systems.json"
    run = ["--out", str(tmp_path / "kept"), "--json", str(record), "--part", "out", "--part", "in"]
    told = CliRunner().invoke(benchmark.main, run, catch_exceptions=False)
    assert told.exit_code == 0
    (row,) = json.loads(record.read_text())["rows"]
    assert (row["left_out"], row["left_in"]) == ("right", "right")
    found = row["answers"]["out"]
    (effect,) = found["effects"]
    size = effect["parameters"]["coefficient"]
    assert size["low"] < 3.0 < size["high"]
    assert size["unit"] == "N/(m/s)"
    error = found["errors"]["speed_mps"]
    assert error["found"] < 0.2 * error["fitted"]
    body = real_systems.named(Records(tmp_path)).body
    assert "| cart | " in body
    assert FRICTION in body


def test_halves_share_no_sample(cart):
    whole, first, second = (recordings_of(cart, p)[0] for p in ("out", "first", "second"))
    joined = np.concatenate([first.columns["speed_mps"], second.columns["speed_mps"]])
    assert np.array_equal(joined, whole.columns["speed_mps"])


def _said(*effects, verdict="named", rivals=()):
    return {"verdict": verdict, "class": rivals, "effects": [{"name": n} for n in effects]}


@pytest.mark.parametrize(
    ("answer", "out", "built_in"),
    [
        (_said("a"), "right", "wrong"),
        (_said("a", "b"), "right", "wrong"),
        (_said("a", "z"), "partly", "wrong"),
        (_said("b"), "wrong", "next"),
        (_said("z"), "wrong", "wrong"),
        (_said("a", verdict="class", rivals=("a", "z")), "class", "wrong"),
        (_said("b", verdict="class", rivals=("b", "z")), "wrong", "next"),
        (_said("z", "a", verdict="class", rivals=("a", "y")), "partly", "wrong"),
        (_said("a", "y", verdict="class", rivals=("y", "z")), "partly", "wrong"),
        (_said("a", "b", verdict="class", rivals=("b", "z")), "class", "wrong"),
        (_said("a", verdict="unknown", rivals=("a", "x", "y", "z")), "nothing", "unsure"),
        (_said(verdict="none"), "nothing", "right"),
        (_said(verdict="unknown"), "nothing", "unsure"),
    ],
)
def test_the_judge(answer, out, built_in):
    case = Case("one", "", "", (), ("a",), "", further=("b",))
    assert judged_left_out(case, answer) == out
    assert judged_left_in(case, answer) == built_in


def test_what_is_still_missing_may_be_named_once_the_rest_is_built_in():
    added = Added((), lambda state, inputs, c: {}, leaves=("a",))
    case = Case("one", "", "", (), ("a", "x"), "", added=added)
    assert judged_left_in(case, _said("a")) == "next"
    assert judged_left_in(case, _said("x")) == "wrong"


def test_halves_agree_by_what_they_name():
    assert agreement(_said("a"), _said("a")) == "same"
    assert agreement(_said("a", "b"), _said("a")) == "in part"
    assert agreement(_said("a"), _said("b")) == "differ"
    assert agreement(_said(verdict="none"), _said(verdict="none")) == "same"


def test_every_case_has_its_system_and_its_columns():
    for case in CASES:
        parts = [p for p in PARTS if p != "in" or case.added is not None]
        for part in parts:
            ports = {p.name for p in system_of(case, part).ports}
            assert {n.rpartition("@")[2] for n in (*case.expected, *case.further)} <= ports
