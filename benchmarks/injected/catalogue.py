"""Every fault by name, in the order of the table."""

from benchmarks.injected import (
    board,
    computer,
    hopeless,
    link,
    people,
    plant,
    predictions,
    second,
    sensor,
)
from benchmarks.injected.fault import NONE, Fault

_GROUPS = (computer, predictions, sensor, link, board, plant, people, second, hopeless)
FAULTS: dict[str, Fault] = {
    fault.name: fault for fault in (NONE, *(fault for group in _GROUPS for fault in group.FAULTS))
}
assert len(FAULTS) == 1 + sum(len(group.FAULTS) for group in _GROUPS)
GROUPS = tuple(dict.fromkeys(fault.group for fault in FAULTS.values()))
