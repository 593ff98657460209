"""A recorded flight on the page of a flying one: at its own pace, faster, slower, from anywhere.

In: a run log. Out: a page. The measured force is the smoothed one, which looks both ways in time.
"""

import asyncio
import bisect
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from runtime.live_view import rig_view
from runtime.measured_force import measure
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.failsafes import hints
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.core.runlog_columns import Value
from wakedeploy.live.address import address_of, token_for
from wakedeploy.live.events import events_of
from wakedeploy.live.rows import COLUMNS, page_row
from wakedeploy.live.web import (
    PageServer,
    Refused,
    Visitor,
    application,
    listening,
    serve,
)
from wakedeploy.rig.file import default_rig, parse_rig

OnProgress = Callable[[int, int], None]

SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
SHOWN_S = 30.0  # before the place to which a person jumps


def rig_of_log(log: RunLog) -> Rig:
    """The rig that a log was flown with; the default one where it does not say."""
    text = log.metadata.get("rig_toml")
    return default_rig() if not text else parse_rig(text, "the log's rig")


def log_rows(log: RunLog, rig: Rig, progress: OnProgress | None = None) -> list[list[Value]]:
    """The page's rows of a whole log, with the smoothed force where it can be measured.

    `progress(done, total)` is called as the smoothing gets on.
    """
    force_n = _smoothed_force(log, rig, progress)
    return [
        page_row(row | {"force_now_n": None if np.isnan(n) else float(n)})
        for row, n in zip(log.rows(), force_n, strict=True)
    ]


def _smoothed_force(log: RunLog, rig: Rig, progress: OnProgress | None) -> Any:
    """(T,) [N], NaN where nothing was flown."""
    force_n = np.full(len(log), np.nan)
    try:
        _, (stretches,) = measure([log.without_truth()], rig, progress)
    except UnusableInput:  # too short, or never in the air
        return force_n
    for stretch in stretches:
        force_n[stretch.ticks] = stretch.force_n
    return force_n


def _untimed(log: RunLog, rows: list[list[Value]]) -> str:
    """Why a log does not say what the computer took; "" where it does."""
    if any(row[COLUMNS.index("compute_s")] is not None for row in rows):
        return ""
    simulated = log.metadata.get("simulated") == "true"
    return "not measured in simulated time" if simulated else "not recorded"


class Replay(PageServer):
    """A log that is played; every page sees the same place of it. It begins with the first page.

    An hour of flight takes a minute to smooth: `progress(done, total)` is called meanwhile. Raises
    UnusableInput for a log without a tick, and for a rig in it that cannot be used.
    """

    def __init__(self, log: RunLog, name: str, progress: OnProgress | None = None) -> None:
        super().__init__()
        if not len(log):
            raise UnusableInput(f"{name}: there is not a single tick in this log.")
        rig = rig_of_log(log)
        self._rows = log_rows(log, rig, progress)
        self._times = [float(t) for t in log["t_s"]]
        self._next = 0
        self._at_s, self._speed, self._plays = self._times[0], 1.0, True
        self._last_s, self._is_seen = time.monotonic(), False
        self.hub.news(
            kind="replay", phase="replay", title=name, rig=rig_view(rig), log=name,
            hints=hints(is_virtual=log.metadata.get("simulated") == "true"),
            begin_s=self._times[0], end_s=self._times[-1], watches_gap="gap_score" in log,
            untimed=_untimed(log, self._rows),
            events=events_of(log), speeds=SPEEDS,
        )  # fmt: skip
        self._tell()

    def _tell(self) -> None:
        self.hub.news(plays=self._plays, speed=self._speed)

    def look(self) -> None:
        """Let time pass, and take what was flown meanwhile."""
        now_s = time.monotonic()
        if not self._is_seen:  # a log of seconds would be over before anybody has opened the page
            self._is_seen = any(visitor.is_let_in for visitor in self.visitors)
            self._last_s = now_s
        if self._plays:
            self._at_s += self._speed * (now_s - self._last_s)
            until = bisect.bisect_right(self._times, self._at_s)
            for row in self._rows[self._next : until]:
                self.hub.add(row)
            self._next = until
            self._plays = until < len(self._times)
        self._last_s = now_s
        self._tell()

    def carry_out(self, said: dict[str, Any], now_s: float) -> dict[str, Any] | None:
        """Play, pause, another speed, another place."""
        match said:
            case {"do": "play"}:
                if self._next >= len(self._times):
                    self._jump(self._times[0])
                self._plays = True
            case {"do": "pause"}:
                self._plays = False
            case {"do": "speed", "value": float() | int() as speed} if speed in SPEEDS:
                self._speed = float(speed)
            case {"do": "seek", "value": float() | int() as place}:
                self._jump(float(place))
            case _:
                raise Refused("A replay can play, pause, change its speed and seek.")
        self._tell()
        return None

    def _jump(self, place_s: float) -> None:
        """Begin elsewhere, with the half minute before it."""
        self._at_s = min(max(place_s, self._times[0]), self._times[-1])
        self._next = bisect.bisect_right(self._times, self._at_s)
        first = bisect.bisect_left(self._times, self._at_s - SHOWN_S)
        self.hub.begin()
        for row in self._rows[first : self._next]:
            self.hub.add(row)


def replay(
    read: Callable[[], Replay], listen: str, token_file: Path | None, tell: Callable[[str], None]
) -> None:
    """Serve what `read` returns until the program is interrupted; `tell` gets the address.

    It is called once the address is ours: a long log is not read for a port that is taken.
    """
    address = address_of(listen)
    token = token_for(address, token_file)
    with listening(address) as (sockets, there):
        server = read()
        handlers = [(r"/live", Visitor, {"server": server})]

        async def run() -> None:
            serve(sockets, application(there, token, "live.html", handlers))
            tell(there.link(token))
            await server.run(server.look, lambda: False)

        asyncio.run(run())
