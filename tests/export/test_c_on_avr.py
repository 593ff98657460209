"""C exports on simulated AVRs: the same force, and what is too large is said to be."""

import needs
import numpy as np
import pytest
from made_packages import package_of, sound, tiny_manifest, tiny_model

from benchmarks.microcontroller.avr import MEGA, UNO, Mcu, on_avr
from export.c.packaging import Wish, export_c
from runtime.compiled.predictor import CompiledPredictor

pytestmark = [needs.simulator]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A small package with a state, as C."""
    package = sound(package_of(tiny_model("state"), tiny_manifest("state")))
    return export_c(package, tmp_path_factory.mktemp("avr") / "c", Wish())


@pytest.mark.parametrize("mcu", [UNO, MEGA], ids=lambda mcu: mcu.name)
def test_a_step_gives_the_same_force_on_an_avr(folder, mcu):
    found = on_avr(folder, mcu)
    assert found.why_not == ""
    here, inputs = CompiledPredictor(folder), np.full(2, 0.1, np.float32)
    here.step(inputs)
    assert found.force == pytest.approx(tuple(here.step(inputs)), rel=1e-5)
    assert folder.document.weight_bytes < found.flash < mcu.flash
    assert folder.document.state_bytes < found.ram < mcu.ram
    assert 1 < found.cycles < 100_000
    assert found.ms == pytest.approx(found.cycles / 16e3)


def test_what_does_not_fit_is_not_run(folder):
    found = on_avr(folder, Mcu("half an UNO", UNO.mcu, 256, UNO.ram, UNO.ram_end))
    assert found.why_not == "too large for its memories"
    assert (found.cycles, found.force) == (0, ())
    assert found.flash > 256
