"""`wakedeploy export --c`, `check FOLDER` and a folder's files, from the command line."""

import json
import os
import re
import shutil
import subprocess
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from click.testing import CliRunner
from made_packages import package_of, parsed, sound, tiny_manifest, tiny_model
from needs import c_compiler

from runtime.compiled import proof
from runtime.compiled.compiler import host_compiler
from runtime.compiled.driven import driven
from runtime.compiled.folder import read_c_folder
from runtime.compiled.predictor import CompiledPredictor
from runtime.compiled.proof import proved
from runtime.limits import Limits
from runtime.predictor import PackagePredictor
from wakedeploy.cli import main
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.package import Package, write_package

pytestmark = [c_compiler]

MATRIX = """t (float[B, 2] observation, float[B, 2] state_leaky)
    => (float[B, 2] force, float[B, 2] next_state_leaky)
    { turned = Gemm <transB: int = 1> (state_leaky, turn)
      next_state_leaky = Add (turned, observation)
      force = Tanh (next_state_leaky) }"""


def turning(**changes: object) -> Package:
    """A package with one matrix, whose float32 weights no int8 has."""
    turn = np.array([[0.8, -0.301], [0.123, 0.7]], np.float32)
    model = parsed(MATRIX, {"turn": turn}).SerializeToString()
    return sound(package_of(model, tiny_manifest("state", **changes)))


def remembering() -> Package:
    """A package whose matrix has rows enough to be rounded; readouts stay as they are."""
    body = """t (float[B, 2] observation, float[B, 8] state_past)
        => (float[B, 2] force, float[B, 8] next_state_past)
        { turned = Gemm <transB: int = 1> (state_past, turn)
          driven = Gemm <transB: int = 1> (observation, inward)
          next_state_past = Add (turned, driven)
          force = Gemm <transB: int = 1> (next_state_past, outward) }"""
    draw = np.random.default_rng(0)
    sizes = {"turn": (8, 8), "inward": (8, 2), "outward": (2, 8)}
    weights = {n: (0.2 * draw.normal(size=s)).astype(np.float32) for n, s in sizes.items()}
    states = {"past": {"shape": [8], "initial": 0.0}}
    manifest = tiny_manifest("state", memory={"kind": "state", "states": states})
    return sound(package_of(parsed(body, weights).SerializeToString(), manifest))


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("package") / "turning.onnx"
    write_package(turning(), path)
    return path


@pytest.fixture(scope="module")
def made(package: Path) -> Path:
    """A folder of C that nothing changes."""
    folder = package.parent / "turning_c"
    said = wakedeploy("export", "--package", package, "--c", folder)
    assert said.exit_code == 0, said.output
    return folder


@pytest.fixture
def copied(made: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(made, tmp_path / "copied"))


def wakedeploy(*arguments: object):
    return CliRunner().invoke(main, [str(argument) for argument in arguments])


def refused(*arguments: object) -> str:
    """The one sentence of a command that ends with status 2."""
    said = wakedeploy(*arguments)
    assert said.exit_code == 2, said.output
    assert said.output.count("\n") <= 3, said.output
    return said.output


def test_a_package_becomes_four_files_that_a_compiler_alone_can_prove(made, tmp_path):
    assert {path.name for path in made.iterdir()} == {"gru.c", "gru.h", "gru_test.c", "README.md"}
    program = tmp_path / "self-test"
    sources = [made / "gru.c", made / "gru_test.c"]
    subprocess.run(["cc", "-O2", *sources, "-o", program, "-lm"], check=True)
    said = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    assert re.fullmatch(r"gru: passed, max_rel \S+ over 3200 steps, limit 1.0e-05\n", said)
    assert "over the force's range" in (made / "gru_test.c").read_text()
    assert "a share of the force's range" in (made / "README.md").read_text()  # of the same measure


def test_a_step_at_a_rigs_pace_tells_what_the_package_tells(made):
    folder = read_c_folder(made)
    series = driven(folder.manifest, 200)
    compiled, package = CompiledPredictor(folder), PackagePredictor(turning())
    for now in series:
        assert np.allclose(compiled.step(now), package.step(now), atol=1e-6)
        assert compiled.ready == package.ready
    assert compiled.lead_s == package.lead_s == 0.09
    compiled.reset()
    assert not compiled.ready


def test_series_in_lockstep_keep_apart(made):
    folder = read_c_folder(made)
    series = driven(folder.manifest, 50)
    both, alone = CompiledPredictor(folder, batch=2), CompiledPredictor(folder)
    for now in series:
        assert np.array_equal(both.step(np.stack([-now, now]))[1], alone.step(now))
    with pytest.raises(UnusableInput, match="shape"):
        alone.step(np.zeros(3))


def test_check_proves_a_folder_again_and_says_so(made, tmp_path):
    said = wakedeploy("check", made, "--json", tmp_path / "check.json")
    assert said.exit_code == 0, said.output
    told = json.loads((tmp_path / "check.json").read_text())
    assert told["ok"]
    assert told["here"][0]["flags"] == "-O2"
    assert told["here"][0]["max_rel"] <= 1e-5
    assert told["steps"] == 3200


def test_fast_math_is_proved_where_it_is_asked_for(package, tmp_path):
    folder = tmp_path / "fast"
    flags = "-O3 -ffast-math"
    assert (
        wakedeploy("export", "--package", package, "--c", folder, "--cflags", flags).exit_code == 0
    )
    assert f"`{flags}`" in (folder / "README.md").read_text()
    assert [proof.flags for proof in read_c_folder(folder).document.proofs][-1] == flags
    smallest = np.float32(1e-45)
    assert smallest / np.float32(1.0) > 0.0, "the process still knows subnormal numbers"


@pytest.mark.parametrize("name", ["gru.c", "gru.h", "gru_test.c"])
def test_an_altered_file_is_refused(copied, name):
    path = copied / name
    path.write_text(path.read_text().replace("0", "1", 1))
    assert "altered or damaged" in refused("check", copied) or name == "gru.c"
    with pytest.raises(UnusableInput):
        read_c_folder(copied)


def test_a_weight_that_somebody_changed_is_found_by_its_hash(copied):
    source = copied / "gru.c"
    source.write_text(source.read_text().replace("0.8f", "0.9f"))
    assert "altered or damaged" in refused("check", copied)


@pytest.mark.parametrize("name", ["gru.c", "gru.h", "gru_test.c"])
def test_a_missing_file_is_told(copied, name):
    (copied / name).unlink()
    assert "export --c" in refused("check", copied)


def test_a_folder_of_something_else_is_told(tmp_path):
    assert "no C source" in refused("check", tmp_path)
    (run := tmp_path / "s0").mkdir()
    for name in ("config.json", "best.safetensors"):
        (run / name).touch()
    assert f"`wakedeploy export --run {run}`" in refused("check", run)
    (tmp_path / "main.c").write_text("int main(void) { return 0; }\n")
    assert "not made by wakedeploy" in refused("check", tmp_path)


@pytest.mark.whole
def test_rounding_beyond_the_tolerance_leaves_nothing(tmp_path_factory, tmp_path):
    package = tmp_path_factory.mktemp("wide") / "wide.onnx"
    write_package(remembering(), package)
    said = wakedeploy(
        "export", "--package", package, "--c", tmp_path / "c", "--weights", "int8",
        "--tolerance", 0.01,
    )  # fmt: skip
    assert said.exit_code == 1
    assert "int8" in said.output
    assert list(tmp_path.iterdir()) == []
    again = wakedeploy(
        "export", "--package", package, "--c", tmp_path / "c", "--weights", "int8",
        "--tolerance", 5,
    )  # fmt: skip
    assert again.exit_code == 0, again.output
    assert "int8 weights change the force" in (tmp_path / "c" / "README.md").read_text()


def test_c_that_differs_leaves_nothing(package, tmp_path, monkeypatch):
    monkeypatch.setattr("export.c.arithmetic.FORMS", _off_by_a_little())
    said = wakedeploy("export", "--package", package, "--c", tmp_path / "c")
    assert said.exit_code == 1
    words = " ".join(said.output.split())
    assert "The C of this gru: its self-test fails with -O2" in words
    assert "nothing was written" in words
    assert "compiler's version" in words
    assert str(tmp_path) not in words, "what it names would be gone"
    assert "fly it" not in words
    assert list(tmp_path.iterdir()) == []


def test_flags_that_the_compiler_does_not_take_are_named(package, tmp_path):
    said = wakedeploy(
        "export", "--package", package, "--c", tmp_path / "c", "--cflags", "--no-such-flag"
    )
    assert said.exit_code == 1
    words = " ".join(said.output.split())
    assert "--no-such-flag does not compile it" in words
    assert "nothing was written. Give other --cflags." in words
    assert list(tmp_path.iterdir()) == []


def test_folders_above_are_made_and_go_again_where_the_export_fails(package, tmp_path, monkeypatch):
    there = tmp_path / "p" / "q" / "r"
    with monkeypatch.context() as damaged:
        damaged.setattr("export.c.arithmetic.FORMS", _off_by_a_little())
        assert wakedeploy("export", "--package", package, "--c", there).exit_code == 1
    assert list(tmp_path.iterdir()) == []
    assert wakedeploy("export", "--package", package, "--c", there).exit_code == 0
    assert (there / "gru.c").exists()


def _off_by_a_little() -> dict[str, str]:
    from export.c.values import FORMS

    return FORMS | {"Tanh": "tanhf({} * 1.001f)"}


def test_a_machine_without_a_compiler_is_told_so_before_anything_is_made(
    package, made, tmp_path, monkeypatch
):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    assert "no C compiler" in refused("export", "--package", package, "--c", tmp_path / "c")
    assert list(tmp_path.iterdir()) == []
    assert "no C compiler" in refused("check", made)


def test_a_compiler_that_cc_names_is_taken_with_its_arguments_or_refused(
    package, made, tmp_path, monkeypatch
):
    monkeypatch.setenv("CC", "/no/such/compiler")
    assert "no such program" in refused("export", "--package", package, "--c", tmp_path / "c")
    assert "no such program" in refused("check", made)
    monkeypatch.setenv("CC", "cc 'unclosed")
    assert "correct the variable CC" in refused("check", made)
    cc = shutil.which("cc")
    monkeypatch.setenv("CC", "env LANG=C cc")
    assert host_compiler()[1:] == ("LANG=C", "cc")
    assert wakedeploy("check", made).exit_code == 0
    monkeypatch.delenv("CC")
    assert host_compiler() == (cc,)


def test_a_folder_that_is_there_and_a_name_that_c_refuses(package, made, tmp_path):
    assert "is there already" in refused("export", "--package", package, "--c", made)
    there = tmp_path / "c"
    assert "--name" in refused("export", "--package", package, "--c", there, "--name", "int")
    assert not there.exists()
    assert wakedeploy("export", "--package", package, "--c", there, "--name", "wake").exit_code == 0
    assert "wake_step(wake_state *state" in (there / "wake.h").read_text()


@pytest.mark.parametrize(
    "options",
    [("--package", "p.onnx"), ("--weights", "int8"), ("--name", "x"), ("--cflags", "-O3")],
)
def test_options_of_c_without_c_are_told(options):
    assert "belongs to --c" in refused("export", *options)


def test_a_run_and_a_package_are_not_given_both(package, tmp_path):
    told = refused("export", "--package", package, "--c", tmp_path / "c", "--arch", "gru")
    assert "one of the two" in told


def test_a_graph_that_is_none_of_the_eight_is_refused(tmp_path):
    body = """t (float[B, 2] observation, float[B, 2] state_leaky)
        => (float[B, 2] force, float[B, 2] next_state_leaky)
        { force = Pow (observation, three) next_state_leaky = Add (state_leaky, observation) }"""
    model = parsed(body, {"three": np.float32(3.0)}).SerializeToString()
    write_package(package_of(model, tiny_manifest("state")), tmp_path / "cubed.onnx")
    told = refused("export", "--package", tmp_path / "cubed.onnx", "--c", tmp_path / "c")
    assert "another power than 2" in told
    assert not (tmp_path / "c").exists()


@pytest.mark.parametrize(
    ("body", "constants", "words"),
    [
        ("x = Gemm <beta: float = 0.5, transB: int = 1> (observation, matrix, pair)", {},
         "scales its bias"),
        ("x = LayerNormalization (observation, one, pair)", {"one": np.ones(1, np.float32)},
         "gain or bias"),
        ("x = LayerNormalization (observation, pair, one)", {"one": np.ones(1, np.float32)},
         "gain or bias"),
    ],
)  # fmt: skip
def test_an_operator_that_c_would_compute_otherwise_is_refused(tmp_path, body, constants, words):
    write_package(_normed(body, constants), tmp_path / "p.onnx")
    assert words in refused("export", "--package", tmp_path / "p.onnx", "--c", tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_a_layer_normalisation_without_a_bias_adds_none(tmp_path):
    package = sound(_normed("x = LayerNormalization (observation, pair)", {}))
    write_package(package, tmp_path / "p.onnx")
    for kind in ("float32", "int8"):
        said = wakedeploy("export", "--package", tmp_path / "p.onnx", "--c", tmp_path / kind,
                          "--weights", kind)  # fmt: skip
        assert said.exit_code == 0, said.output
    series = driven(package.manifest, 20)
    compiled, onnx = (
        CompiledPredictor(read_c_folder(tmp_path / "float32")),
        PackagePredictor(package),
    )
    for now in series:
        assert np.allclose(compiled.step(now), onnx.step(now), atol=1e-6)


def _normed(made: str, constants: dict[str, np.ndarray]) -> Package:
    """A package whose force is `x`, and whose state is a sum."""
    body = f"""t (float[B, 2] observation, float[B, 2] state_leaky)
        => (float[B, 2] force, float[B, 2] next_state_leaky)
        {{ {made} force = Tanh (x) next_state_leaky = Add (state_leaky, observation) }}"""
    all_of_them = {"pair": np.array([0.5, 2.0], np.float32), "matrix": np.eye(2, dtype=np.float32)}
    model = parsed(body, {n: v for n, v in (all_of_them | constants).items() if n in made})
    return package_of(model.SerializeToString(), tiny_manifest("state"))


def test_hostile_names_and_units_stay_within_comments_and_literals(tmp_path):
    """A package may come from anyone; what it is called must not become code."""
    hostile = '*/ int x = 1; /* " ??/ \\'
    body = MATRIX.replace("turned", '"*/ evil"').replace("turn)", '"main(){}")')
    turn = np.array([[0.8, -0.3], [0.1, 0.7]], np.float32)
    model = parsed(MATRIX, {"turn": turn})
    assert body != MATRIX
    for initializer in model.graph.initializer:
        initializer.name = hostile
    model.graph.node[0].input[1] = hostile
    model.graph.node[0].output[0] = model.graph.node[1].input[0] = "int"
    channels = [{"name": n, "unit": hostile[:30], "min": -1.0, "max": 1.0} for n in ("a", "b")]
    manifest = tiny_manifest("state", domain=hostile, observation=channels)
    write_package(sound(package_of(model.SerializeToString(), manifest)), tmp_path / "h.onnx")
    said = wakedeploy("export", "--package", tmp_path / "h.onnx", "--c", tmp_path / "c")
    assert said.exit_code == 0, said.output
    folder = read_c_folder(tmp_path / "c")
    assert folder.manifest.domain == hostile
    assert proved(folder).max_rel <= 1e-5
    done = subprocess.run(
        ["cc", "-std=c99", "-Wall", "-Wextra", "-Wcomment", "-Werror", "-fsyntax-only",
         folder.source], capture_output=True, text=True,
    )  # fmt: skip
    assert done.stderr == ""


def test_a_library_is_compiled_once(made, tmp_path, monkeypatch):
    from runtime.compiled.compiler import shared_library

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    source = read_c_folder(made).source
    first = shared_library(source)
    made_at = os.stat(first).st_mtime_ns
    assert shared_library(source) == first
    assert os.stat(first).st_mtime_ns == made_at
    assert first.is_relative_to(tmp_path)
    assert shared_library(source, ("-O1",)) != first


def test_an_empty_graph_name_is_enough(tmp_path):
    """Packages without memory, and with a window of a stride, become folders, too."""
    for kind in ("none", "window"):
        write_package(sound(package_of(tiny_model(kind), tiny_manifest(kind))), tmp_path / "p.onnx")
        said = wakedeploy("export", "--package", tmp_path / "p.onnx", "--c", tmp_path / kind)
        assert said.exit_code == 0, said.output


@pytest.mark.parametrize(
    ("body", "says"),
    [
        ("for (;;) { }", "took more than 1 s of processor time with -O2; do not fly it."),
        ("sleep(60);", "had not ended after 3 s with -O2; do not fly it."),
        ("if (!fork()) { sleep(60); } wait(0);", "had not ended after 3 s with -O2"),
        ("char *p; while ((p = malloc(1 << 24))) memset(p, 1, 1 << 24); abort();", "SIGABRT"),
        ('for (;;) puts("max_rel 0 over 1 steps");', "fails with -O2 (was ended by SIGXFSZ"),
    ],
    ids=["spins", "sleeps", "forks", "takes memory", "prints"],
)
def test_a_strangers_self_test_meets_its_limits(tmp_path, monkeypatch, body, says):
    """It is a program that anybody wrote: it is ended as a package's trial is."""
    seconds = 30.0 if "processor" in says else 3.0  # a busy machine gives little of its own
    monkeypatch.setattr(proof, "LIMITS", Limits(seconds=seconds, cpu_s=1.0, memory_mib=256))
    headers = "".join(f"#include <{n}.h>\n" for n in ("stdio", "stdlib", "string", "unistd"))
    source, test = tmp_path / "source.c", tmp_path / "test.c"
    source.write_text("extern int nothing;\nint nothing = 0;\n")
    test.write_text(
        f"#define _POSIX_C_SOURCE 200809L\n{headers}#include <sys/wait.h>\n"
        f"int main(void) {{ {body} return 0; }}\n"
    )
    folder = SimpleNamespace(path=tmp_path, source=source, test=test)
    before, began_s = _children(), time.monotonic()
    with pytest.raises(CheckFailed) as failed:
        proved(folder)
    assert says in str(failed.value)
    assert "do not fly it" in str(failed.value)
    assert time.monotonic() < began_s + 40.0
    assert _children() <= before


def _children() -> set[str]:
    """The processes that this one has started, those of other tests among them."""
    return set(Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children").read_text().split())
