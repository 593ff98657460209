"""What pages are sent: the newest minutes of rows, and the state, each page at its own pace."""

import json
import secrets
from collections import deque
from typing import Any

from wakedeploy.core.runlog_columns import Value
from wakedeploy.live.rows import COLUMNS

KEPT = 32 * 120  # rows, two minutes
MOST_AT_ONCE = 320  # rows for a page that fell behind, ten seconds


class Hub:
    """Numbered rows and a state. A page asks for what came after what it has seen.

    `epoch` names this sequence of rows: a page that has rows of another one forgets them.
    """

    def __init__(self) -> None:
        self.state: dict[str, Any] = {}
        self.version = 0
        self._cached: tuple[tuple[int | str, ...], str] = ((), "")
        self.begin()

    def begin(self) -> None:
        """Forget the rows: others follow that do not continue them."""
        self.epoch = secrets.token_hex(4)
        self._rows: deque[list[Value]] = deque(maxlen=KEPT)
        self.count = 0
        self.version += 1

    def add(self, row: list[Value]) -> None:
        """The next row."""
        self._rows.append(row)
        self.count += 1

    def news(self, **state: Any) -> None:
        """Change the state; pages hear of it where something is new."""
        if any(self.state.get(key, ...) != value for key, value in state.items()):
            self.state |= state
            self.version += 1

    def frame(self, seen: int, version: int, epoch: str) -> str | None:
        """A message with what a page has not seen; None where there is nothing.

        `seen` counts the rows that it has, -1 for a page that has just come: it gets all.
        """
        if epoch != self.epoch:
            seen = -1
        if seen >= self.count and version == self.version:
            return None
        key = (seen, version, self.epoch, self.count, self.version)
        if self._cached[0] != key:  # pages that keep up are all sent the same
            self._cached = (key, self._encoded(seen, version))
        return self._cached[1]

    def _encoded(self, seen: int, version: int) -> str:
        fresh = self.count - max(seen, 0)
        kept = min(fresh, len(self._rows), KEPT if seen < 0 else MOST_AT_ONCE)
        message: dict[str, Any] = {"seen": self.count, "version": self.version, "epoch": self.epoch}
        message["rows"] = [self._rows[i] for i in range(len(self._rows) - kept, len(self._rows))]
        if version != self.version:
            message["state"] = self.state
        if seen < 0:
            message["columns"] = COLUMNS
        return json.dumps(message, separators=(",", ":"))
