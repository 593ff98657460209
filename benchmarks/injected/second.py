"""A second fault on the way down: somebody stops the flight, and then something breaks."""

from functools import partial

from benchmarks.injected import board, computer, link, plant, predictions, sensor
from benchmarks.injected.fault import Fault, Scene
from benchmarks.injected.people import stops

GROUP = "second fault"
AFTER_S = 0.4
SECOND = {
    fault.name: fault
    for group in (computer, predictions, sensor, link, board, plant)
    for fault in group.FAULTS
}
CHOSEN = (
    "stall 95 ms",
    "stall 250 ms",
    "exception in control, once",
    "range silent",
    "range frozen",
    "range -0.3 m",
    "link cut",
    "link cut, 0.5 s",
    "status says not armed",
    "thrust -20 %",
)


def first_stops(scene: Scene, *, second: Fault) -> None:
    """Somebody stops the flight; the second fault begins on the way down."""
    stops(scene)
    scene.later(AFTER_S, partial(second.begin, scene))
    if second.lasts_s < float("inf"):
        scene.later(AFTER_S + second.lasts_s, scene.restore)


FAULTS = tuple(
    Fault(
        f"stop, then {name}",
        f"Somebody stops the flight, and {AFTER_S:g} s later: {SECOND[name].sentence}",
        GROUP,
        partial(first_stops, second=SECOND[name]),
        obeys=SECOND[name].obeys,
    )
    for name in CHOSEN
)
