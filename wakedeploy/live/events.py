"""What happens in a flight: the mode changes, a fault begins."""

from typing import Any

from wakedeploy.core.runlog import RunLog

MOST = 200  # the newest; a fault that comes and goes fills any list

Event = list[Any]  # [t in s, "mode" or "fault", its name]


class Events:
    """Found row by row."""

    def __init__(self) -> None:
        self.found: list[Event] = []
        self._mode, self._faults = "", set[str]()

    def see(self, t_s: float, mode: str, faults: str) -> bool:
        """Take one tick; whether something happened in it."""
        named = {name for name in faults.split("+") if name}
        new: list[Event] = [[round(t_s, 3), "mode", mode]] if mode != self._mode else []
        new += [[round(t_s, 3), "fault", name] for name in sorted(named - self._faults)]
        self._mode, self._faults = mode, named
        self.found = (self.found + new)[-MOST:] if new else self.found
        return bool(new)


def events_of(log: RunLog) -> list[Event]:
    """Those of a whole log."""
    events = Events()
    for t_s, mode, faults in zip(log["t_s"], log["mode"], log["faults"], strict=True):
        events.see(float(t_s), str(mode), str(faults))
    return events.found
