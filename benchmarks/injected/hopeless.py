"""What no command can save: motors that do not obey, and pushes beyond the thrust reserve."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from benchmarks.injected.fault import Fault, Scene
from benchmarks.injected.plant import push

GROUP = "not survivable"


def pins(
    scene: Scene, *, drive: Callable[[float, float, float, float], tuple[float, float]]
) -> None:
    """ESCs get other pulses than the board's: of idle, full and the board's two."""
    idle_us, full_us = scene.rig.limits.pulse_us
    scene.world.plant.drive = lambda source, sufferer: drive(idle_us, full_us, source, sufferer)


def stuck(scene: Scene) -> None:
    """The sufferer's ESC holds its last pulse."""
    last_us = scene.world.plant.sufferer_applied_us
    scene.world.plant.drive = lambda source, sufferer: (source, last_us)


def battery_pulled(scene: Scene) -> None:
    """Both motors stop, and the board measures that the battery is gone."""
    pins(scene, drive=lambda idle, full, source, sufferer: (idle, idle))
    scene.world.board.status = lambda status: replace(status, battery_mv=0)


def _fault(name: str, sentence: str, begin: Callable[[Scene], None]) -> Fault:
    return Fault(name, sentence, GROUP, begin, obeys=False, survivable=False)


FAULTS = (
    _fault("sufferer at full", "The sufferer's ESC is stuck at full thrust.",
           partial(pins, drive=lambda idle, full, source, sufferer: (source, full))),
    _fault("sufferer stuck", "The sufferer's ESC is stuck at its last pulse.", stuck),
    _fault("sufferer dead", "The sufferer's motor stops.",
           partial(pins, drive=lambda idle, full, source, sufferer: (source, idle))),
    _fault("battery pulled", "Both motors stop.",
           partial(pins, drive=lambda idle, full, source, sufferer: (idle, idle))),
    replace(
        _fault("battery pulled, measured", "Both motors stop; the board measures it.",
               battery_pulled),
        rig={"battery": {"has_divider": True}},
    ),
    _fault("source at full", "The source's ESC is stuck at full thrust.",
           partial(pins, drive=lambda idle, full, source, sufferer: (full, sufferer))),
    push(-6.0, GROUP),
    push(5.0, GROUP),
)  # fmt: skip
