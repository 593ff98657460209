"""People and disks: a stop by hand, a recorder that fails."""

import errno

from benchmarks.injected.fault import Fault, Scene

GROUP = "people"


def stops(scene: Scene) -> None:
    """Somebody stops the flight."""
    scene.loop.stop_asked = True


def recorder_fails(scene: Scene) -> None:
    """The recorder says that it takes no more."""
    scene.rows.error = "the recording cannot go on"


def disk_full(scene: Scene) -> None:
    """Taking a row raises what a full disk raises."""

    def full() -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    scene.world.before["record"] = full


FAULTS = (
    Fault("operator stop", "Somebody stops the flight.", GROUP, stops),
    Fault("recorder fails", "The recorder says that it takes no more.", GROUP, recorder_fails),
    Fault("disk full", "Taking a row raises what a full disk raises.", GROUP, disk_full),
)
