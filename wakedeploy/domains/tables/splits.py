"""Which recordings of logs are held out: whole files, files by their names, or stretches of time.

In: recordings by file, and `[training]` of `columns.toml`. Out: pieces with their splits. No
recording is in two splits unless the splits are stretches of time.
"""

import fnmatch
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from wakedeploy.core.episodes import SPLITS
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.domains.split import split_in_order
from wakedeploy.domains.tables.columns import Columns
from wakedeploy.domains.tables.reading import without_ending

_HELD_OUT = 0.15  # of each trial, for validation and for test
_MOST_NAMED = 6  # logs in a sentence

Piece = tuple[str, str, Recording]  # split, name, samples
Pieces = list[Piece]
Parts = Sequence[Recording]
ByFile = Mapping[Path, tuple[Recording, ...]]


def split_pieces(recordings: ByFile, columns: Columns) -> Pieces:
    """Every recording with its split, cut where splits are stretches of time.

    Raises UnusableInput for patterns that match no log or leave none, and for too few logs.
    """
    named = _named(list(recordings), columns)
    drawn = [split for split in SPLITS if split not in named.values()]
    rest = [path for path in recordings if path not in named]
    by_file = named | _drawn(rest, drawn, columns)
    found: Pieces = []
    for path, parts in recordings.items():
        if path in by_file:
            found += [(by_file[path], recording.name, recording) for recording in parts]
        else:
            found += _cut_by_time(parts, drawn, columns)
    cut = [parts for path, parts in recordings.items() if path not in by_file]
    if cut and {split for split, _, _ in found} != set(SPLITS):
        raise _too_short(cut[0])
    return found


def _named(paths: Sequence[Path], columns: Columns) -> dict[Path, str]:
    """The split of each file that a pattern names."""
    found: dict[Path, str] = {}
    for split in ("validation", "test"):
        for pattern in getattr(columns.training, split):
            matched = _matched(paths, pattern)
            if not matched:
                raise UnusableInput(
                    f"{columns.file}: training.{split}: {pattern!r} matches no log; there are"
                    f" {_listed(paths)}."
                )
            both = [path for path in matched if found.get(path, split) != split]
            if both:
                raise UnusableInput(
                    f"{columns.file}: training: {both[0]} is in validation and in test; name it in"
                    " one of them."
                )
            found |= dict.fromkeys(matched, split)
    if len(found) == len(paths):
        every = "the only log" if len(paths) == 1 else f"all {len(paths)} logs"
        raise UnusableInput(
            f"{columns.file}: training: validation and test match {every}, and none is left for"
            " training; name fewer, or give more logs."
        )
    return found


def _matched(paths: Sequence[Path], pattern: str) -> list[Path]:
    """The logs that a pattern names: those that are called so, or else those that it matches.

    A log is called by its name, or with a slash by its path from any folder on; either with the
    file's ending or without. `run[1].csv` may be a name, and as a pattern would not match it.
    """
    wanted = pattern.removeprefix("./")
    with_folder = "/" in pattern
    names = {path: _names(path, with_folder=with_folder) for path in paths}
    equal = [path for path in paths if wanted in names[path]]
    return equal or [
        path for path in paths if any(fnmatch.fnmatchcase(name, wanted) for name in names[path])
    ]


def _names(path: Path, *, with_folder: bool) -> list[str]:
    parts = path.as_posix().split("/")
    starts = range(len(parts)) if with_folder else (len(parts) - 1,)
    tails = ["/".join(parts[start:]) for start in starts]
    return [*tails, *map(without_ending, tails)]


def _listed(paths: Sequence[Path]) -> str:
    shown = ", ".join(path.as_posix() for path in paths[:_MOST_NAMED])
    more = len(paths) - _MOST_NAMED
    return shown if more <= 0 else f"{shown} and {more} more"


def _drawn(paths: Sequence[Path], splits: Sequence[str], columns: Columns) -> dict[Path, str]:
    """The split of each file that no pattern names; nothing where those files are cut by time."""
    if len(splits) == 1:
        return dict.fromkeys(paths, splits[0])
    held_out = columns.training.held_out
    if held_out == "time" or (held_out is None and len(paths) < len(splits)):
        return {}
    if len(paths) < len(splits):
        raise _too_few(paths, splits)
    if len(splits) == len(SPLITS):
        names = split_in_order([str(path) for path in paths])
        return {path: names[str(path)] for path in paths}
    held = max(1, round(_HELD_OUT * len(paths)))
    return {p: splits[i >= len(paths) - held] for i, p in enumerate(paths)}


def _too_few(paths: Sequence[Path], splits: Sequence[str]) -> UnusableInput:
    named = [f"training.{s}" for s in SPLITS if s not in splits]
    rest = f" that {' and '.join(named)} does not name" if named else ""
    there = "there is 1" if len(paths) == 1 else f"there are {len(paths)}"
    return UnusableInput(
        f'{paths[0]}: held_out = "files" needs at least {len(splits)} logs{rest}, and {there}; give'
        ' more, or held_out = "time".'
    )


def _cut_by_time(parts: Parts, splits: Sequence[str], columns: Columns) -> Iterator[Piece]:
    """The recordings of a log in stretches: training first, then 15 % of it for each other split.

    Each trial in a log is cut by itself, as its end is an end of what was done. Where a stretch of
    it would be no longer than the window, it is cut with all others that are so short.
    UnusableInput where a split has fewer than two samples.
    """
    if min(np.diff(_marks(parts, splits))) < 2:
        raise _too_short(parts)
    fewest = _fewest(columns.training.window_s, parts[0].rate_hz)
    short: list[Recording] = []
    for trial in _trials(parts, columns.split.gap_s):
        if min(np.diff(_marks(trial, splits))) >= fewest:
            yield from _stretches(trial, splits)
        else:
            short += trial
    yield from _stretches(short, splits)


def _trials(parts: Parts, gap_s: float | None) -> list[list[Recording]]:
    """The recordings of a log by trial: another begins where the clock falls, or after `gap_s`.

    Missing readings end a recording and no trial.
    """
    found = [[parts[0]]]
    for before, recording in pairwise(parts):
        silence_s = recording.time_s[0] - before.time_s[-1]
        if silence_s < 0.0 or (gap_s is not None and silence_s > gap_s):
            found.append([])
        found[-1].append(recording)
    return found


def _marks(parts: Parts, splits: Sequence[str]) -> list[int]:
    """Where splits begin and end, in samples that are counted through all of the recordings."""
    samples = sum(len(recording.time_s) for recording in parts)
    ends = [1.0 - _HELD_OUT * (len(splits) - place) for place in range(1, len(splits) + 1)]
    return [0, *(round(end * samples) for end in ends)]


def _stretches(parts: Parts, splits: Sequence[str]) -> Iterator[Piece]:
    """Recordings that are cut as one; a stretch of a single sample is left out."""
    marks, first = _marks(parts, splits), 0
    for recording in parts:
        after = first + len(recording.time_s)
        for split, low, high in zip(splits, marks, marks[1:], strict=False):
            part = slice(max(low, first) - first, max(min(high, after) - first, 0))
            if len(recording.time_s[part]) >= 2:
                yield split, f"{recording.name}-{split}", _cut(recording, part)
        first = after


def _too_short(parts: Parts) -> UnusableInput:
    samples = sum(len(recording.time_s) for recording in parts)
    return UnusableInput(
        f"{parts[0].name}: has {samples} samples, too few to cut into splits; give a longer"
        ' log, or held_out = "files".'
    )


def _cut(recording: Recording, part: slice) -> Recording:
    columns = {name: values[part] for name, values in recording.columns.items()}
    return replace(recording, time_s=recording.time_s[part], columns=columns)


def long_enough(pieces: Pieces, window_s: float, rate_hz: float) -> Pieces:
    """The pieces that are longer than the window; UnusableInput where a split has none."""
    fewest = _fewest(window_s, rate_hz)
    kept = [piece for piece in pieces if len(piece[2].time_s) >= fewest]
    for split in SPLITS:
        if any(has == split for has, _, _ in kept):
            continue
        name, longest = max(
            ((name, part) for has, name, part in pieces if has == split),
            key=lambda piece: len(piece[1].time_s),
        )
        raise UnusableInput(
            f"{name}: lasts {len(longest.time_s) / rate_hz:.3g} s and is the longest of the {split}"
            f" split, which has no recording that is longer than the window of {window_s:g} s; give"
            " longer logs, a shorter window_s, or another split in [training]."
        )
    return kept


def _fewest(window_s: float, rate_hz: float) -> float:
    """Samples of a piece that is longer than the window."""
    return window_s * rate_hz + 2
