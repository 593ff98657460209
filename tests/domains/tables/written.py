"""Tables of text for tests: what they hold, how they are written, and how a guess reads them."""

from pathlib import Path

import numpy as np

from wakedeploy.domains.tables.columns import parse_columns
from wakedeploy.domains.tables.guess import guess_columns
from wakedeploy.domains.tables.reading import read_recordings

ROWS = np.column_stack([np.arange(60) / 20.0, np.sin(np.arange(60)), np.cos(np.arange(60))])


def text(rows: np.ndarray, delimiter: str, decimal: str = ".") -> str:
    lines = [delimiter.join(f"{v:.5f}".replace(".", decimal) for v in row) for row in rows]
    return "\n".join(lines) + "\n"


def read(path: Path) -> tuple[str, np.ndarray]:
    """What is guessed, and the columns that it gives once each is an output."""
    guessed = guess_columns(path)
    known = guessed.replace("rate_hz = 0 ", "rate_hz = 20 ").replace('"unused"', '"output"')
    (recording,) = read_recordings([path], parse_columns(known)).recordings
    return guessed, np.column_stack(list(recording.columns.values()))
