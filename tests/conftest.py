"""What all tests share: how examples are drawn, signals, packages to compute by hand."""

import math
import multiprocessing
import signal
from collections.abc import Callable

import hypothesis
import needs
import numpy as np
import pytest
import warm

from wakedeploy.package import Example, Manifest, Package, make_package

# The same examples in every run: a check that fails must fail again. `make explore` draws new ones.
# How long an example takes depends on what else the machine does.
_UNTIMED = {"deadline": None, "suppress_health_check": [hypothesis.HealthCheck.too_slow]}
hypothesis.settings.register_profile("repeatable", derandomize=True, **_UNTIMED)
hypothesis.settings.register_profile("explore", print_blob=True, **_UNTIMED)
hypothesis.settings.load_profile("repeatable")

# A script ignores SIGINT in what it runs in the background, and so would all that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """What was skipped, a line for each reason; why a test that flies in real time flew again."""
    skipped = terminalreporter.stats.get("skipped", [])
    for line in needs.skipped_lines(report.longrepr[2] for report in skipped):
        terminalreporter.write_line(line)
    for report in terminalreporter.stats.get("rerun", []):
        crash = getattr(report.longrepr, "reprcrash", None)
        why = crash.message if crash else str(report.longrepr)
        terminalreporter.write_line(f"RETRIED {report.nodeid}: {why.strip().splitlines()[0]}")


@pytest.fixture(autouse=True, scope="session")
def boards_boot_at_once():
    """An UNO's bootloader takes 1.7 s: one test waits for it, and so do whole commands."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("runtime.virtual.process.VirtualGantryProcess.boot_s", 0.1)
        yield


@pytest.fixture(autouse=True, scope="session")
def workers_begin_warm():
    """Importing torch takes each worker two seconds; commands started as programs spend them."""
    ordinary, begun_warm = multiprocessing.get_context, warm.context()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OMP_NUM_THREADS", "1")  # as workers do before they import
        patch.setattr(
            multiprocessing,
            "get_context",
            lambda method=None: begun_warm if method == "spawn" else ordinary(method),
        )
        yield


@pytest.fixture(autouse=True, scope="session")
def nothing_tells_how_far_it_is():
    """Commands in this process say it after two seconds: what they print hung on the machine."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wakedeploy.cli.log_lines._SILENT_S", math.inf)
        yield


BODIES = {
    # the force is the sum of the observation's two channels
    "none": "t (float[B, 2] observation) => (float[B, 1] force)"
    "{ axes = Constant <value_ints: ints = [1]> () force = ReduceSum (observation, axes) }",
    # first channel: newest less oldest; second channel: all snapshots
    "window": "t (float[B, 3, 2] window) => (float[B, 2] force)"
    "{ force = Einsum <equation = 'bkd,kdo->bo'> (window, weights) }",
    # a leaky sum of the observation's channels, which is also the force
    "state": "t (float[B, 2] observation, float[B, 2] state_leaky)"
    " => (float[B, 2] force, float[B, 2] next_state_leaky)"
    "{ half = Constant <value_float: float = 0.5> () kept = Mul (state_leaky, half)"
    "  next_state_leaky = Add (kept, observation) force = Identity (next_state_leaky) }",
}
MEMORIES: dict[str, dict] = {
    "none": {"kind": "none"},
    "window": {"kind": "window", "k": 3, "stride": 2},
    "state": {"kind": "state", "states": {"leaky": {"shape": [2], "initial": [1.0, -1.0]}}},
}


def tiny_model(kind: str) -> bytes:
    onnx = pytest.importorskip("onnx")
    weights = np.zeros((3, 2, 2), np.float32)
    weights[2, 0, 0], weights[0, 0, 0], weights[:, 1, 1] = 1.0, -1.0, 1.0
    body = BODIES[kind].replace("'", '"')
    model = onnx.parser.parse_model(f'<ir_version: 10, opset_import: ["" : 20]> {body}')
    if kind == "window":
        model.graph.initializer.append(onnx.numpy_helper.from_array(weights, "weights"))
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString()


def tiny_manifest(kind: str, **changes: object) -> Manifest:
    channels = [{"name": n, "unit": "m", "min": -1.0, "max": 1.0} for n in ("dx_m", "dz_m")]
    forces = [{"name": n, "unit": "N"} for n in ("fx_n", "fz_n")]
    fields = {
        "arch": "gru", "hyper": {"hidden": 2}, "domain": "gantry", "rate_hz": 32.0,
        "lead_s": 0.09, "observation": channels, "force": forces[: 1 if kind == "none" else 2],
        "memory": MEMORIES[kind], "warm_up_steps": {"none": 1, "window": 5, "state": 8}[kind],
        "trainable": 12, "frozen": 0, "data_sha256": "0" * 64, "seed": 0, "test": None,
        "parity": {"max_abs": 0.0, "max_rel": 0.0, "steps": 3200, "limit": 1e-5},
        "versions": {"torch": "2.13.0"}, "graph_sha256": "0" * 64,
    }  # fmt: skip
    return Manifest.model_validate(fields | changes)


@pytest.fixture(scope="session")
def tiny_package() -> Callable[..., Package]:
    """A function of the memory's kind, and of manifest fields that differ from the default."""

    def make(kind: str, **changes: object) -> Package:
        manifest = tiny_manifest(kind, **changes)
        observation = np.linspace(-1, 1, 24, dtype=np.float32).reshape(12, 2)
        example = Example(0, observation, np.zeros((12, len(manifest.force)), np.float32))
        return make_package(tiny_model(kind), manifest, example)

    return make
