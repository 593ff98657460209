"""Logs as an episode set, which `train` takes.

In: files and `Columns`, of which some have the role observation or force. Out: an `EpisodeSet`.
"""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from pydantic import JsonValue

from wakedeploy.core.episodes import FILTERED, Array, Channel, Episode, EpisodeSet
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.even_time import RATES_DIFFER, meant_hz
from wakedeploy.core.recording import Recording
from wakedeploy.core.version import VERSION
from wakedeploy.domains.tables.columns import Columns, Role
from wakedeploy.domains.tables.learnable import (
    on_constants,
    on_copies,
    on_filter,
    on_other_sizes,
    on_what_is_left_out,
    require_apart,
    require_fine_enough,
    require_no_copies,
    require_roles,
    require_several_samples,
)
from wakedeploy.domains.tables.reading import Progress, Reading, read_recordings
from wakedeploy.domains.tables.splits import long_enough, split_pieces

_MOST = float(np.finfo(np.float32).max)


def import_set(
    paths: Sequence[Path | str], columns: Columns, progress: Progress | None = None
) -> EpisodeSet:
    """Read logs as a set of episodes.

    Args:
        paths: Files, or folders of files that belong together.
        columns: What their columns mean; at least one observation and one force.
        progress: Called with the files done and their number.

    Returns:
        Observations (T, d) and forces (T, o), in the order of `columns`; what was noticed is in
        `provenance["notes"]`.

    Raises:
        UnusableInput: Names file, column, row and reason.
    """
    require_roles(columns)
    reading = read_recordings(paths, columns, progress=progress)
    hashes = {path: dict(_hashes(path)) for path in reading.pieces}
    require_no_copies({path: tuple(found.values()) for path, found in hashes.items()})
    rate_hz = _rate_hz(reading, columns)
    require_several_samples(columns, rate_hz)
    found = split_pieces(reading.pieces, columns)
    pieces = long_enough(found, columns.training.window_s, rate_hz)
    require_apart(pieces, columns)
    require_fine_enough(pieces, columns, reading.units)
    constants = tuple(on_constants(pieces, columns))
    copies = on_copies(pieces, columns, reading.units, rate_hz)
    left_out = on_what_is_left_out(reading, found, pieces, columns)
    sizes = on_other_sizes(reading, columns)
    notes = (*reading.notes, *sizes, *copies, *constants, *left_out, *on_filter(columns))
    return EpisodeSet(
        domain=columns.training.name,
        rate_hz=rate_hz,
        observation=_channels(columns, reading, "observation"),
        force=_channels(columns, reading, "force"),
        window_s=columns.training.window_s,
        loss_weights=_loss_weights(columns),
        split={name: split for split, name, _ in pieces},
        episodes=tuple(_episode(name, piece, columns) for _, name, piece in pieces),
        provenance=_provenance(hashes, columns, notes),
    )


def _rate_hz(reading: Reading, columns: Columns) -> float:
    """The rate that all recordings share: as asked for, or as their stamps mean it."""
    rates = [recording.rate_hz for recording in reading.recordings]
    for path, pieces in reading.pieces.items():
        for recording in pieces:
            if abs(recording.rate_hz / rates[0] - 1.0) > RATES_DIFFER:
                raise UnusableInput(
                    f"{path}: runs at {recording.rate_hz:.4g} Hz and the first log at"
                    f" {rates[0]:.4g} Hz; give [resample] rate_hz in columns.toml."
                )
    usual_hz = float(np.median(rates))
    is_asked_for = columns.resample is not None or columns.time.rate_hz is not None
    return float(f"{usual_hz:.6g}") if is_asked_for else meant_hz(usual_hz)


def _channels(columns: Columns, reading: Reading, role: Role) -> tuple[Channel, ...]:
    names = columns.with_role(role)
    return tuple(Channel(name, reading.units[name]) for name in names)


def _loss_weights(columns: Columns) -> tuple[float, ...]:
    forces = columns.with_role("force")
    for name in columns.training.loss_weights:
        if name not in forces:
            raise UnusableInput(f"{columns.file}: training.loss_weights.{name} is no force.")
    return tuple(columns.training.loss_weights.get(name, 1.0) for name in forces)


def _episode(name: str, piece: Recording, columns: Columns) -> Episode:
    return Episode(
        name, _array(name, piece, columns, "observation"), _array(name, piece, columns, "force")
    )


def _array(name: str, piece: Recording, columns: Columns, role: Role) -> Array:
    """The columns of a role (T, d) as a set keeps them; UnusableInput for what overflows there."""
    names = columns.with_role(role)
    values = np.column_stack([piece.columns[column] for column in names])
    fits = np.abs(values) < _MOST
    if not fits.all():
        _, at = np.argwhere(~fits)[0]
        raise UnusableInput(
            f"{name}: column {list(names)[at]!r} holds a number too large for a measurement; mend"
            " it, or leave the column out."
        )
    return values.astype(np.float32)


def _provenance(
    hashes: Mapping[Path, Mapping[str, str]], columns: Columns, notes: Sequence[str]
) -> dict[str, JsonValue]:
    made: dict[str, JsonValue] = {
        "generator": f"wakedeploy {VERSION} table",
        "columns": columns.model_dump(mode="json", exclude_defaults=True),
        "files": {name: digest for found in hashes.values() for name, digest in found.items()},
        "notes": list(notes),
    }
    if columns.training.lead_s:
        made["default_lead_s"] = columns.training.lead_s
    if columns.resample and columns.resample.method == "low-pass":
        low_pass = f"second-order Butterworth low-pass, {columns.resample.effective_cutoff_hz:g} Hz"
        made[FILTERED] = dict.fromkeys(columns.with_role("observation"), low_pass)
    return made


def _hashes(path: Path) -> Iterator[tuple[str, str]]:
    """The files of a log, by their names below what was given, with their hashes."""
    inside = sorted(p for p in path.rglob("*") if p.is_file()) if path.is_dir() else [path]
    for file in inside:
        with file.open("rb") as opened:
            digest = hashlib.file_digest(opened, "sha256").hexdigest()
        yield str(file.relative_to(path.parent)), digest
