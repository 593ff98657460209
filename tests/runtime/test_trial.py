"""A package's trial ends: by itself, at a limit, or by Ctrl-C, and the sentence says which.

What the reader of packages refuses is let through here, in both processes, as if it had been
fooled: onnxruntime is to hang, to take memory and to die.
"""

import functools
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hostile_models import looping, plain
from made_packages import gantry_package, package_of, sound, tiny_manifest
from said import sentences

from runtime import trial
from runtime.replay import replay
from runtime.request import RunRequest
from runtime.run import fly
from runtime.trial import Limits, require_trial, tried
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.package import Example, make_package, write_package
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import default_rig

ROOT, PYTHON = Path(__file__).parents[2], sys.executable
PLAIN = {"memory": {"kind": "none"}, "warm_up_steps": 1}
# A reader of packages that believes everything.
FOOLED = """
import sys
import wakedeploy.core.package as p
from wakedeploy.core.onnx_wire import metadata
def believed(model, name):
    told = metadata(model)
    manifest = p.Manifest.model_validate_json(told[p.MANIFEST_KEY])
    return p.Package(manifest, model, p.Example.from_json(told[p.EXAMPLE_KEY]))
p.package_from_bytes = believed
"""


@pytest.fixture
def fooled(tmp_path, monkeypatch):
    """An interpreter in whose trials the reader has been fooled."""
    script = tmp_path / "python"
    body = f"{FOOLED}import runtime.trial as trial\nsys.argv = ['', sys.argv[-1]]\ntrial.main()"
    script.write_text(f'#!/bin/sh\nexec {sys.executable} -c "{body}" "$@"\n')
    script.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(script))
    return script


def hanging():
    """A package that loops for thirty years."""
    return package_of(looping(10**15), tiny_manifest("window", **PLAIN))


def greedy():
    """A package whose constant takes four terabytes once it is run."""
    model = plain(
        "{ m = ConstantOfShape (n) s = ReduceMean <keepdims: int = 0> (m, axes)"
        " force = Add (observation, s) }",
        n=np.array([10**6, 10**6]), axes=np.array([0, 1]),
    )  # fmt: skip
    return package_of(model, tiny_manifest("window", **PLAIN))


def test_a_sound_package_comes_out_as_it_does_here(tiny_package):
    package, waited = sound(tiny_package("state")), []
    assert tried(package, waiting=lambda: waited.append(1)) == replay(package)
    assert waited


def test_what_a_check_fails_on_is_said_as_it_is_here(tiny_package):
    with pytest.raises(CheckFailed, match="The example rollout differs from its record"):
        tried(tiny_package("state"))


def test_what_cannot_be_read_there_is_said(tiny_package, fooled):
    fooled.write_text(f'#!/bin/sh\nPYTHONPATH={ROOT} exec {PYTHON} "$@"\n')
    with pytest.raises(UnusableInput, match="its graph uses the operator 'Loop'"):
        tried(hanging())


def test_a_loop_without_an_end_meets_the_limit_of_processor_time(fooled):
    with pytest.raises(CheckFailed, match=r"took more than 0\.5 s of processor time"):
        tried(hanging(), Limits(cpu_s=0.5))


def test_a_loop_without_an_end_meets_the_limit_of_time(fooled):
    began_s = time.monotonic()
    with pytest.raises(CheckFailed, match="had not ended after 1 s"):
        tried(hanging(), Limits(seconds=1.0))
    assert time.monotonic() - began_s < 10.0  # of the thirty years


def test_a_model_that_takes_memory_meets_its_limit(fooled):
    with pytest.raises(CheckFailed, match="took more than 1024 MiB of memory"):
        tried(greedy())


def test_a_trial_that_dies_is_named_with_what_it_died_of(tiny_package, fooled):
    fooled.write_text("#!/bin/sh\necho 'free(): invalid pointer' >&2; kill -SEGV $$\n")
    with pytest.raises(CheckFailed, match=r"was ended by SIGSEGV \(free\(\): invalid pointer\)"):
        tried(tiny_package("state"))
    fooled.write_text("#!/bin/sh\nexit 3\n")
    with pytest.raises(CheckFailed, match=r"exit status 3 \(no word\)"):
        tried(tiny_package("state"))


def test_ctrl_c_ends_a_check_that_hangs_at_once(tmp_path, fooled):
    write_package(hanging(), tmp_path / "p.onnx")
    code = f"{FOOLED}from wakedeploy.cli import main\nsys.executable = {str(fooled)!r}\nmain()"
    line = [PYTHON, "-c", code, "check", tmp_path / "p.onnx"]
    check = subprocess.Popen(line, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    child = awaited(functools.partial(child_of, check.pid))
    awaited(lambda: processor_time_s(child) > 1.0)  # in the loop, which hears nothing
    began_s = time.monotonic()
    check.send_signal(signal.SIGINT)
    _, err = check.communicate(timeout=10)
    assert check.returncode == 130
    assert sentences(err) == ["Interrupted."]
    assert time.monotonic() - began_s < 5.0
    assert not Path(f"/proc/{child}").exists()


def awaited(found):
    """What a function finds in the end."""
    end_s = time.monotonic() + 30.0
    while not (what := found()):
        assert time.monotonic() < end_s
        time.sleep(0.02)
    return what


def child_of(pid: int) -> int | None:
    children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
    return int(children[0]) if children else None


def processor_time_s(pid: int) -> float:
    return sum(map(int, Path(f"/proc/{pid}/stat").read_text().split()[13:15])) / 100.0


def test_a_trial_whose_parent_is_gone_ends_by_itself():
    code = "import runtime.limits as t; t.limit(t.Limits(seconds=0.1))\nwhile True: pass"
    ended = subprocess.run([PYTHON, "-c", code], cwd=ROOT, timeout=20, check=False)
    assert ended.returncode == -signal.SIGALRM


def test_a_package_is_tried_once_however_often_it_flies(tiny_package, monkeypatch):
    package, others = tiny_package("state", seed=77), []
    monkeypatch.setattr(trial, "tried", lambda package, waiting: others.append(package) or "passed")
    assert [require_trial(package) for _ in range(3)] == ["passed"] * 3
    assert len(others) == 1
    require_trial(tiny_package("state", seed=78))
    assert len(others) == 2


def test_a_package_that_was_never_checked_does_not_fly(tmp_path):
    rig, log = default_rig(), tmp_path / "flight.mcap"
    good = gantry_package(default_lead_s(rig))
    said = Example(0, good.example.observation, good.example.force + np.float32(1.0))
    write_package(make_package(good.model_bytes, good.manifest, said), tmp_path / "p.onnx")
    with pytest.raises(CheckFailed, match="The example rollout differs from its record"):
        fly(RunRequest(rig, 6.0, package=tmp_path / "p.onnx", log=log))
    assert not log.exists()
