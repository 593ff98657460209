"""What a predictor can learn of logs, and what is wrong with them for that.

In: `Columns`, and pieces of recordings with their splits. Out: remarks; UnusableInput for what
could not be learnt from.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise, product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.episodes import whole_steps
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.core.units import conversion
from wakedeploy.domains.tables.columns import Column, Columns, Role
from wakedeploy.domains.tables.reading import Reading
from wakedeploy.domains.tables.splits import Pieces

Vector = NDArray[np.float64]

_SAME = 0.5  # share of a recording's stretches from which on it is another's copy
_STRETCH = 10  # rows: where a log has few digits, single ones are alike by chance
_CUTS = 5  # rows that a copy may lack
_FEW = 0.005  # the share of labels from which on it is said
_NEAR = 1e-9  # of the largest number, by which a conversion of units may move it
_CONSTANT = 2e-9  # of a value, by which a log's own arithmetic may change it
_ROUNDED = 0.01  # of a column's spread, by which the rounding of a set may change its numbers
_APART = 30.0  # times as large as in other logs; rad and deg are 57 apart, m and mm 1000


def require_roles(columns: Columns) -> None:
    """UnusableInput without observations and forces that have numbers everywhere."""
    needed: tuple[Role, ...] = ("observation", "force")
    for role in needed:
        if not columns.with_role(role):
            raise UnusableInput(
                f"{columns.file}: no column has the role {role!r}; a set for training needs"
                " observations and forces."
            )
    for name, column in columns.with_role("observation", "force").items():
        if column.missing == "nan":
            raise UnusableInput(
                f'{columns.file}: columns.{name}.missing = "nan" is nothing to learn from; give'
                ' "hold" or "split".'
            )


def require_fine_enough(pieces: Pieces, columns: Columns, units: Mapping[str, str]) -> None:
    """UnusableInput for a column that a set's float32 would round to a few steps.

    A position in UTM coordinates, 5600 km from where these begin, moves in steps of half a metre.
    """
    for name, column in columns.with_role("observation", "force").items():
        values = np.concatenate([part.columns[name] for _, _, part in pieces])
        spread = float(values.std())
        rounding = float(np.std(values - values.astype(np.float32)))
        usual = float(values.mean())
        if rounding <= _ROUNDED * spread or spread < _CONSTANT * abs(usual):
            continue
        step = float(np.spacing(np.float32(usual)))
        in_unit = f"{usual:.6g} {units[name]}".removesuffix(" 1")
        per_unit = float(conversion(column.unit, units[name]))
        offset = column.offset - float(f"{usual / per_unit:.7g}")
        raise UnusableInput(
            f"{columns.file}: columns.{name} stays near {in_unit} and changes by {spread:.2g}, and "
            f"sets keep single precision, in steps of {step:.2g} there; give "
            f"offset = {offset!r}, which counts from a point nearby."
        )


def on_copies(
    pieces: Pieces, columns: Columns, units: Mapping[str, str], rate_hz: float
) -> Iterator[str]:
    """Remarks on forces that are seen as well; UnusableInput where they are seen in time."""
    seen, forces = columns.with_role("observation"), columns.with_role("force")
    for (name, column), (force, label) in product(seen.items(), forces.items()):
        pairs = [
            (_in_log(part.columns[name], column, units[name]),
             _in_log(part.columns[force], label, units[force]))
            for _, _, part in pieces
        ]  # fmt: skip
        is_one = _source(column) == _source(label)
        if not is_one and _share_alike(pairs, 0.0) < 1.0:
            continue
        ahead_s = columns.training.lead_s + column.shift_s - label.shift_s
        both = f"{column.address!r} and {label.address!r} hold the same numbers"
        twice = f"{column.address!r} is observation and force" if is_one else both
        if ahead_s <= 0.0:
            raise UnusableInput(
                f"{columns.file}: columns.{force}: {twice}, and a predictor would copy"
                f" {'it' if is_one else 'them'}; delete the role observation of columns.{name}, or"
                " give [training] lead_s to forecast it."
            )
        share = _share_alike(pairs, columns.training.lead_s * rate_hz)
        yield (
            f"column{'' if is_one else 's'} {twice}: only with a lead is there anything to learn,"
            f" so never train with a shorter one{_on_share(share)}"
        )


def _source(column: Column) -> tuple[object, ...]:
    return (column.file, column.addresses, column.angle)


def _on_share(share: float) -> str:
    if share < _FEW:
        return ""
    return (
        f"; with this one {100.0 * share:.0f} % of the labels are what is seen, so give a lead_s no"
        " shorter than the column's own step"
    )


def _in_log(values: Vector, column: Column, unit: str) -> Vector:
    """A column's values (n,) as the numbers that its log has."""
    with np.errstate(all="ignore"):  # a scale of 0 leaves no number
        return (values / float(conversion(column.unit, unit)) - column.offset) / column.scale


def _share_alike(pairs: Sequence[tuple[Vector, Vector]], lead: float) -> float:
    """The share of values that their pair has `lead` samples later; between two, at both."""
    few, many = int(np.floor(lead + _NEAR)), int(np.ceil(lead - _NEAR))
    alike = []
    for seen, label in pairs:
        count = max(len(seen) - many, 0)
        off_by = [np.abs(label[ahead:][:count] - seen[:count]) for ahead in (few, many)]
        alike.append(np.maximum(*off_by) <= _NEAR * np.abs(seen).max())
    together = np.concatenate(alike)
    return float(together.mean()) if len(together) else 0.0


def on_other_sizes(reading: Reading, columns: Columns) -> Iterator[str]:
    """Remarks on logs in which a column is far larger or smaller than in the others.

    One log in millimetres among others in metres makes every other a standstill. In another unit
    the usual value is as far off as the largest; a neighbour that comes near in one log alone
    moves only that. A force that is small in few logs may be so, where no neighbour is.
    """
    for name, column in columns.with_role("observation", "force").items():
        sizes = {path: _sizes(parts, name) for path, parts in reading.pieces.items()}
        order = sorted((p for p, size in sizes.items() if size[0] > 0.0), key=lambda p: sizes[p])
        for k in range(1, len(order)):
            if _APART * sizes[order[k - 1]][0] >= sizes[order[k]][0]:
                continue
            below, above = order[:k], order[k:]
            most, least = max(sizes[p][1] for p in below), min(sizes[p][1] for p in above)
            if not 0.0 < _APART * most < least:
                continue
            if len(above) > len(below) and "force" in column.roles:
                continue
            odd, others = (above, below) if len(above) <= len(below) else (below, above)
            unit = reading.units[name]
            for path in odd:
                yield (
                    f"{path}, column {column.address!r}: it goes up to {sizes[path][0]:.3g} {unit},"
                    f" in other logs to {_span([sizes[p][0] for p in others])} {unit}; check"
                    " whether it is in another unit"
                )


def _sizes(parts: Sequence[Recording], name: str) -> tuple[float, float]:
    """The largest size of a column's values in a log, and the usual one."""
    values = np.abs(np.concatenate([p.columns[name] for p in parts]))
    return float(values.max()), float(np.median(values))


def _span(sizes: Sequence[float]) -> str:
    least, most = f"{min(sizes):.3g}", f"{max(sizes):.3g}"
    return least if least == most else f"{least} to {most}"


def require_several_samples(columns: Columns, rate_hz: float) -> None:
    """UnusableInput for a window that ends within the newest sample: nothing could remember."""
    window_s = columns.training.window_s
    if whole_steps(window_s * rate_hz) < 1:
        raise UnusableInput(
            f"{columns.file}: training.window_s = {window_s:g} is less than the {1.0 / rate_hz:.4g}"
            f" s from sample to sample of these logs, at {rate_hz:g} Hz; check the unit of the"
            " stamps in [time], or give a longer window."
        )


def require_no_copies(digests: Mapping[Path, tuple[str, ...]]) -> None:
    """UnusableInput for a log that is another's copy: it could be learned from and tested on."""
    seen: dict[tuple[str, ...], Path] = {}
    for path, digest in digests.items():
        if digest in seen:
            raise UnusableInput(
                f"{path}: is a copy of {seen[digest]}, and what a predictor learned from would"
                " judge it; give one of them."
            )
        seen[digest] = path


def require_apart(pieces: Pieces, columns: Columns) -> None:
    """UnusableInput where a held-out recording is a copy of one that is trained on.

    A copy with a row left out, or with another date, is no other recording. Pieces of one recording
    may repeat themselves, as a periodic motion without noise does.
    """
    names = list(columns.with_role("observation", "force"))
    found = [(split, name, _marks(part, names)) for split, name, part in pieces]
    learned = [
        (name, *np.unique(marks, return_index=True)) for split, name, marks in found
        if split == "train"
    ]  # fmt: skip
    for split, name, held_out in (each for each in found if each[0] != "train"):
        for trained_on, known, first in learned:
            if name.removesuffix(f"-{split}") == trained_on.removesuffix("-train"):
                continue
            if (share := _share_in_order(held_out, known, first)) > _SAME:
                raise UnusableInput(
                    f"{name}: {share:.0%} of it is in {trained_on}, too, row after row, and "
                    f"{split} scores would tell of what was learned by heart; give one of both."
                )


def _marks(part: Recording, names: Sequence[str]) -> NDArray[np.uint64]:
    """A number for every few rows (T',) of a recording, 0 where nothing changes in them."""
    rows = np.column_stack([part.columns[n] for n in names])  # (T, d)
    drawn = np.random.default_rng(0).integers(1, 1 << 63, (2, max(len(names), _STRETCH)))
    factors = drawn.astype(np.uint64) | np.uint64(1)
    of_row = (np.ascontiguousarray(rows).view(np.uint64) * factors[0, : len(names)]).sum(1)
    count = len(of_row) - _STRETCH + 1
    if count < 1:
        return np.empty(0, np.uint64)
    marks, moves = np.zeros(count, np.uint64), np.zeros(count, bool)
    for k in range(_STRETCH):
        later = of_row[k : k + count]
        marks += later * factors[1, k]
        moves |= later != of_row[:count]
    return np.where(moves, marks, np.uint64(0))


def _share_in_order(
    held_out: NDArray[np.uint64], known: NDArray[np.uint64], first: NDArray[np.int64]
) -> float:
    """The share of a recording's moving stretches that another has at nearly one distance.

    `known` are the other's marks (m,) in order of size, `first` where each begins.
    """
    moving = np.flatnonzero(held_out)
    if not len(moving) or not len(known):
        return 0.0
    place = np.minimum(np.searchsorted(known, held_out[moving]), len(known) - 1)
    is_there = known[place] == held_out[moving]
    apart = np.sort(moving[is_there] - first[place[is_there]])
    width = max(_CUTS, len(held_out) // 100)  # rows that may have been left out on the way
    together = np.searchsorted(apart, apart + width, side="right") - np.arange(len(apart))
    return float(together.max(initial=0)) / len(moving)


def on_constants(pieces: Pieces, columns: Columns) -> Iterator[str]:
    """Remarks on what never changes in a split; UnusableInput for such a force in training."""
    for name, column in columns.with_role("observation", "force").items():
        value = _constant(pieces, "train", name)
        if value is not None and "force" in column.roles:
            raise UnusableInput(
                f"{columns.file}: columns.{name}: the force {column.address!r} is {value:.6g} in"
                " all recordings for training, which is nothing to learn; give recordings in which"
                " it changes, or another column."
            )
        if value is not None:
            yield (
                f"column {column.address!r}: the observation {name} is {value:.6g} in all"
                " recordings for training, and no predictor knows what another value means; leave"
                " it out"
            )
        if "force" in column.roles:
            yield from _on_still_scores(pieces, name, column)


def _on_still_scores(pieces: Pieces, name: str, column: Column) -> Iterator[str]:
    for split in ("validation", "test"):
        value = _constant(pieces, split, name)
        if value is not None:
            yield (
                f"column {column.address!r}: the force {name} is {value:.6g} in all recordings for"
                f" {split}, where scores then tell nothing of it; give recordings in which it"
                f" changes, or name others in training.{split}"
            )


def _constant(pieces: Pieces, split: str, name: str) -> float | None:
    """The only value of a column in a split, as a set keeps it; None where there are several."""
    with np.errstate(over="ignore"):  # what overflows is refused with its recording
        values = np.concatenate(
            [piece.columns[name] for has, _, piece in pieces if has == split]
        ).astype(np.float32)
    return float(values[0]) if np.ptp(values) == 0.0 else None


def on_filter(columns: Columns) -> Iterator[str]:
    """That a loop has to filter what was filtered here."""
    if columns.resample and columns.resample.method == "low-pass":
        yield (
            "observations went through a low-pass filter of"
            f" {columns.resample.effective_cutoff_hz:g} Hz; in flight filter them likewise, as the"
            " package's description says"
        )


def on_what_is_left_out(
    reading: Reading, found: Pieces, kept: Pieces, columns: Columns
) -> Iterator[str]:
    """Remarks on the time between the pieces of logs, and on pieces that are too short."""
    rate_hz = reading.recordings[0].rate_hz
    holes_s = [
        hole_s
        for parts in reading.pieces.values()
        for before, after in pairwise(parts)
        if (hole_s := after.time_s[0] - before.time_s[-1] - 1.0 / rate_hz) > 0.0
    ]
    total_s = _seconds(found, rate_hz) + sum(holes_s)
    if holes_s:
        yield (
            f"between the pieces of logs, at {len(holes_s)} place{'s' * (len(holes_s) > 1)},"
            f" {_share(sum(holes_s), total_s)}, are left out"
        )
    if len(found) > len(kept):
        short_s = _seconds(found, rate_hz) - _seconds(kept, rate_hz)
        yield (
            f"of {len(found)} pieces, {len(found) - len(kept)} last no longer than the window of"
            f" {columns.training.window_s:g} s, {_share(short_s, total_s)}, and are left out"
        )


def _seconds(pieces: Pieces, rate_hz: float) -> float:
    return sum(len(piece.time_s) for _, _, piece in pieces) / rate_hz


def _share(seconds: float, total_s: float) -> str:
    return f"{seconds:.3g} s, {100.0 * seconds / total_s:.2g} % of {total_s:.4g} s"
