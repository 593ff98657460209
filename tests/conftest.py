"""What all tests share: how examples are drawn, signals, tiny packages."""

import functools
import gc
import importlib.util
import math
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable

import hypothesis
import needs
import pytest
import warm
from made_packages import package_of, tiny_manifest, tiny_model

from wakedeploy.core.package import Package

# At the default of 700 objects a tenth of all time goes into looking for garbage.
gc.set_threshold(50_000)

# The same examples in every run: a check that fails must fail again. `make explore` draws new ones.
# How long an example takes depends on what else the machine does.
_UNTIMED = {"deadline": None, "suppress_health_check": [hypothesis.HealthCheck.too_slow]}
hypothesis.settings.register_profile("repeatable", derandomize=True, **_UNTIMED)
hypothesis.settings.register_profile("explore", print_blob=True, **_UNTIMED)
# Mutants only need to be noticed: the smallest example that does it is of no interest.
hypothesis.settings.register_profile(
    "unshrunk",
    derandomize=True,
    phases=(hypothesis.Phase.explicit, hypothesis.Phase.generate),
    **_UNTIMED,
)
hypothesis.settings.load_profile(os.environ.get("WAKEDEPLOY_EXAMPLES", "repeatable"))

# A script ignores SIGINT in what it runs in the background, and so would all that tests interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_finish() -> None:
    """What collecting has loaded stays: no need to look through it for garbage again and again."""
    gc.collect()
    gc.freeze()


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
def boards_may_take_their_time():
    """A busy machine lets a board's process or thread answer later than half a second."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("runtime.io.conversation.ANSWER_LIMIT_S", 5.0)
        yield


@pytest.fixture(autouse=True)
def what_a_test_imports_from_its_own_folder_is_forgotten(tmp_path_factory):
    """Hooks of the same name in another test's folder are others."""
    path, modules, folders = list(sys.path), set(sys.modules), str(tmp_path_factory.getbasetemp())
    yield
    sys.path[:] = path
    for name in set(sys.modules) - modules:
        file = getattr(sys.modules[name], "__file__", None) or ""
        if file.startswith(folders):
            del sys.modules[name]


@pytest.fixture(autouse=True, scope="session")
def workers_begin_warm():
    """Importing torch takes each worker two seconds; commands started as programs spend them."""
    ordinary = multiprocessing.get_context
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("OMP_NUM_THREADS", "1")  # as workers do before they import
        patch.setattr(
            multiprocessing,
            "get_context",
            lambda method=None: warm.context() if method == "spawn" else ordinary(method),
        )
        yield


@pytest.fixture(autouse=True, scope="session")
def the_exporter_reads_its_library_once():
    """For each graph torch's exporter would parse all 500 functions of its library anew."""
    if importlib.util.find_spec("torch") is None:
        yield
        return
    from export import graph

    exported = graph._exported
    with pytest.MonkeyPatch.context() as patch:

        def once(*arguments):
            from torch.onnx._internal.exporter._registration import ONNXRegistry

            read = functools.cache(ONNXRegistry.from_torchlib)  # by version of the operators
            patch.setattr(ONNXRegistry, "from_torchlib", staticmethod(read))
            patch.setattr(graph, "_exported", exported)
            return exported(*arguments)

        patch.setattr(graph, "_exported", once)
        yield


@pytest.fixture(autouse=True, scope="session")
def nothing_tells_how_far_it_is():
    """Commands in this process say it after two seconds: what they print hung on the machine."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("wakedeploy.cli.log_lines._SILENT_S", math.inf)
        yield


@pytest.fixture(scope="session")
def tiny_package() -> Callable[..., Package]:
    """A function of the memory's kind, and of manifest fields that differ from the default.

    With `ballast` it holds so many frozen weights more.
    """

    def make(kind: str, ballast: int = 0, **changes: object) -> Package:
        manifest = tiny_manifest(kind, **({"frozen": ballast} | changes))
        return package_of(tiny_model(kind, ballast), manifest)

    return make
