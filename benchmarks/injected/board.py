"""The board: it restarts, reports what is false, stops obeying, or its carriage does."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from benchmarks.injected.fault import Fault, Scene
from runtime.io import protocol
from runtime.io.protocol import Status
from runtime.virtual.mcu import Outputs

GROUP = "board"
JUMPS = {"0.3 m": 1260, "0.7 m": 2940, "of the sign bit": -(1 << 31)}


def reboots(scene: Scene) -> None:
    """The board restarts: no pulses, no answer, then one that waits for a greeting."""
    scene.world.board.reboot(scene.world.plant.t_s)


def says(scene: Scene, *, change: Callable[[Status], Status]) -> None:
    """Statuses say something else than what is."""
    scene.world.board.status = change


def deadman(scene: Scene) -> None:
    """The board's deadman ramps to idle though commands come, and latches."""
    limits, plant = scene.rig.limits, scene.world.plant
    began_s, idle_us = plant.t_s, limits.pulse_us[0]
    pins = (plant.source_applied_us, plant.sufferer_applied_us)
    descents_s = (limits.source_descent_s, limits.sufferer_descent_s)

    def ramp(out: Outputs, dt_s: float) -> Outputs:
        shares = [max(0.0, 1.0 - (plant.t_s - began_s) / one_s) for one_s in descents_s]
        source, sufferer = (idle_us + s * (p - idle_us) for s, p in zip(shares, pins, strict=True))
        return Outputs(source, sufferer, 0.0)

    def status(true_status: Status) -> Status:
        is_latched = plant.t_s - began_s > max(descents_s)
        if not is_latched:
            return true_status
        return replace(true_status, armed=False, faults=protocol.Fault.DEADMAN)

    scene.world.board.outputs, scene.world.board.status = ramp, status


def freezes_steps(scene: Scene) -> None:
    """The step count stays what it is."""
    steps = scene.world.plant.steps
    says(scene, change=lambda status: replace(status, steps=steps))


def blocks_carriage(scene: Scene) -> None:
    """The carriage stands still while the board counts its steps."""
    steps_per_m = scene.rig.stepper.steps_per_m
    counted = [0.0]

    def stand(out: Outputs, dt_s: float) -> Outputs:
        counted[0] += out.carriage_mps * dt_s * steps_per_m
        return replace(out, carriage_mps=0.0)

    scene.world.board.outputs = stand
    says(scene, change=lambda status: replace(status, steps=status.steps + round(counted[0])))


def _jumped(status: Status, by: int) -> Status:
    return replace(status, steps=max(-(1 << 31), min(status.steps + by, (1 << 31) - 1)))


FAULTS = (
    Fault("board restarts", "The board restarts in flight: its pulses stop at once.", GROUP,
          reboots, obeys=False, survivable=False),
    Fault("status says watchdog", "The board says that its watchdog has latched.", GROUP,
          partial(says, change=lambda status: replace(status, faults=protocol.Fault.WATCHDOG))),
    Fault("status says not armed", "The board says that it is not armed.", GROUP,
          partial(says, change=lambda status: replace(status, armed=False))),
    Fault("deadman latches", "The board's deadman ramps to idle though commands come.", GROUP,
          deadman, obeys=False, survivable=False),
    Fault("step count frozen", "The board's step count stays what it is.", GROUP, freezes_steps),
    *(
        Fault(f"step count jumps {name}", f"The board's step count jumps by {name}.", GROUP,
              partial(says, change=partial(_jumped, by=by)))
        for name, by in JUMPS.items()
    ),
    Fault("carriage blocked", "The carriage stands still while its steps are counted.", GROUP,
          blocks_carriage),
    Fault("battery reads 0 V", "The board measures no battery any more.", GROUP,
          partial(says, change=lambda status: replace(status, battery_mv=0)),
          rig={"battery": {"has_divider": True}}),
)  # fmt: skip
