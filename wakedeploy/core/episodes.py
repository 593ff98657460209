"""Episode sets: recorded time series to learn from, read and written here and nowhere else.

A set is a folder: `dataset.json` (channels, rate, split, provenance, hashes) and one `.npz` of
float32 arrays for each episode. `dataset.json` is written last and names every file with its hash,
so that a killed writer leaves the set that was there before, or none.
"""

import functools
import hashlib
import io
import json
import math
import numbers
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pydantic
from numpy.typing import NDArray
from pydantic import Field, JsonValue

from wakedeploy.core.archive import read_archive
from wakedeploy.core.errors import UnusableInput, one_line, own_errors
from wakedeploy.core.files import (
    json_of,
    path_from,
    sha256_of,
    text_of,
    write_bytes_whole,
    write_text_whole,
)
from wakedeploy.core.locks import one_at_a_time
from wakedeploy.core.validation import first_problem

SCHEMA = 1
DESCRIPTION = "dataset.json"
SPLITS = ("train", "validation", "test")
WINDOW_SNAPSHOTS = 30
FILTERED = "filtered"  # in a set's provenance: how observations were filtered, in words, by name
OBSERVER = "observer_n"  # extra of sets whose sufferer's motion shows a force without learning

_EPISODE_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,99}")
_EXTRA_NAME = re.compile(r"[a-z][a-z0-9_]{0,63}")
_RESERVED = {
    "observation",
    "force",
    "file",
    "args",
    "kwds",
    "allow_pickle",
}  # savez's own names too
_OWN_FILE = re.compile(r"\.?.+-[0-9a-f]{12}\.npz(\..*)?|\.dataset\.json\..+")

Array = NDArray[np.float32]


@dataclass(frozen=True)
class Channel:
    """One column of the observations (T, d) or of the forces (T, o): its name and its unit.

    An episode set raises ValueError for two channels of one name.
    """

    name: str
    unit: str


@dataclass(frozen=True, eq=False, repr=False)
class Episode:
    """One contiguous recording at a fixed time step, in SI units, T samples long.

    `observation` float32 (T, d), `force` float32 (T, o), `extras` float32 with first axis T.
    Raises ValueError when an array is of another type or shape, not finite, or masked somewhere.
    """

    name: str
    observation: Array
    force: Array
    extras: Mapping[str, Array] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or not _EPISODE_NAME.fullmatch(self.name):
            raise ValueError(f"episode name {self.name!r}: use letters, digits, '.', '_' and '-'")
        for name in self.extras:
            if not _EXTRA_NAME.fullmatch(name) or name in _RESERVED:
                raise ValueError(f"extra array {name!r}: not an allowed name")
        where = f"episode {self.name!r}: "
        _check_array(f"{where}observation", self.observation, None, 2)
        _check_array(f"{where}force", self.force, len(self.observation), 2)
        for name, array in self.extras.items():
            _check_array(f"{where}{name}", array, len(self.observation))

    def __len__(self) -> int:
        return len(self.observation)

    def __repr__(self) -> str:
        shapes = [f"{name} {array.shape}" for name, array in self.arrays.items()]
        return f"<Episode {self.name}: {', '.join(shapes)}>"

    @functools.cached_property
    def sha256(self) -> str:
        """Hash over observation and force, whatever it is called: copies have the same."""
        digest = hashlib.sha256(f"{self.observation.shape}{self.force.shape}".encode())
        for array in (self.observation, self.force):
            digest.update(np.ascontiguousarray(array, dtype="<f4").tobytes())
        return digest.hexdigest()

    @property
    def arrays(self) -> dict[str, Array]:
        """All arrays by name, in a fixed order."""
        extras = {name: self.extras[name] for name in sorted(self.extras)}
        return {"observation": self.observation, "force": self.force} | extras


@dataclass(frozen=True, eq=False, repr=False)
class EpisodeSet:
    """Episodes of one domain that share channels and rate, each assigned to a split.

    Observations are (T, d), forces (T, o), in the units of their channels. `window_s` is the
    history that a window model sees here; `loss_weights` has one weight for each force channel;
    `provenance` is any JSON (seeds, generator, source files). `folder` is where the set was read
    from. Raises ValueError when the parts do not fit together.
    """

    domain: str
    rate_hz: float
    observation: tuple[Channel, ...]
    force: tuple[Channel, ...]
    window_s: float
    loss_weights: tuple[float, ...]
    split: Mapping[str, str]
    episodes: tuple[Episode, ...]
    provenance: Mapping[str, JsonValue] = field(default_factory=dict)
    folder: Path | None = None

    def __post_init__(self) -> None:
        for label in ("rate_hz", "window_s", "loss_weights"):
            object.__setattr__(self, label, _plain(getattr(self, label)))
        _check_kinds(self)
        _check_description(self)
        for episode in self.episodes:
            _check_widths(self, episode)

    @classmethod
    def read(cls, folder: Path | str) -> "EpisodeSet":
        """Read a set from its folder; UnusableInput names the file, the field and the value."""
        return read_episode_set(path_from(folder, "folder"))

    def __repr__(self) -> str:
        observed, forces = (
            ", ".join(f"{channel.name} [{channel.unit}]" for channel in channels)
            for channels in (self.observation, self.force)
        )
        minutes = sum(map(len, self.episodes)) / self.rate_hz / 60
        return (
            f"<EpisodeSet {self.domain}: {len(self.episodes)} episodes, {minutes:.1f} min at"
            f" {self.rate_hz:g} Hz; {observed} → {forces}>"
        )

    def part(self, split: str) -> tuple[Episode, ...]:
        """The episodes of "train", "validation" or "test", or of "all" of them."""
        if split not in (*SPLITS, "all"):
            raise UnusableInput(f"split {split!r} is not known; use {', '.join(SPLITS)} or all.")
        return tuple(e for e in self.episodes if split in ("all", self.split[e.name]))

    @functools.cached_property
    def sha256(self) -> str:
        """Hash over what a model can learn from: arrays, channels, rate, window, weights, split."""
        digest = hashlib.sha256(_canonical(_content(self)).encode())
        for episode in self.episodes:
            for name, array in episode.arrays.items():
                digest.update(f"{episode.name}/{name}{array.shape}".encode())
                digest.update(np.ascontiguousarray(array, dtype="<f4").tobytes())
        return digest.hexdigest()

    @property
    def warm_up_steps(self) -> int:
        """How many samples at the start of each episode no architecture is scored on."""
        return max(1, whole_steps(self.window_s * self.rate_hz))

    def write(self, folder: Path | str) -> None:
        """Write the set; a killed process leaves the set that was in `folder` before, or none.

        Of two processes that write into one folder, the second waits for the first. Raises
        UnusableInput where no folder can be made or written, WakedeployError where a disk is full.
        """
        folder = path_from(folder, "folder")
        if folder.exists() and not folder.is_dir():
            raise UnusableInput(f"{folder}: is a file; give a folder for the episode set.")
        with own_errors(), one_at_a_time(folder, "set", traceless=True):
            entries = [_write_episode(folder, episode) for episode in self.episodes]
            description = json.dumps(_document(self, entries), indent=1) + "\n"
            write_text_whole(folder / DESCRIPTION, description)
            _remove_others(folder, {str(entry["file"]) for entry in entries})


def window_shape(window_s: float, rate_hz: float) -> tuple[int, int]:
    """How a window of `window_s` seconds is sampled: (K snapshots, stride in samples)."""
    stride = max(1, round(window_s * rate_hz / WINDOW_SNAPSHOTS))
    return whole_steps(window_s * rate_hz / stride) + 1, stride


def read_episode_set(folder: Path) -> EpisodeSet:
    """Read and validate a set; UnusableInput names the file, the field, the value and the bound."""
    path = folder / DESCRIPTION
    document = _read_document(path)
    episodes = tuple(_read_episode(folder, entry) for entry in document.episodes)
    try:
        read = EpisodeSet(
            domain=document.domain,
            rate_hz=document.rate_hz,
            observation=tuple(Channel(c.name, c.unit) for c in document.observation),
            force=tuple(Channel(c.name, c.unit) for c in document.force),
            window_s=document.window_s,
            loss_weights=document.loss_weights,
            split=document.split,
            episodes=episodes,
            provenance=document.provenance,
            folder=folder.absolute(),
        )
    except ValueError as error:
        raise UnusableInput(f"{path}: {error}; make or import the set again.") from error
    if read.sha256 != document.sha256:
        raise UnusableInput(f"{path}: sha256 is not that of its episodes; make the set again.")
    return read


def stated_sha256(folder: Path) -> str:
    """The content hash that a set's description states, its arrays unread and unchecked."""
    return _read_document(folder / DESCRIPTION).sha256


@dataclass(frozen=True)
class StatedContents:
    """What a set's description states, its arrays unread and unchecked."""

    domain: str
    episodes: int
    minutes: float
    sha256: str


def stated_contents(folder: Path) -> StatedContents | None:
    """What the set in a folder states of itself; None where there is none that can be read."""
    try:
        read = _read_document(folder / DESCRIPTION)
    except UnusableInput:
        return None
    steps = sum(episode.steps for episode in read.episodes)
    minutes = steps / read.rate_hz / 60.0 if read.rate_hz > 0.0 else 0.0
    return StatedContents(read.domain, len(read.episodes), minutes, read.sha256)


# --- checks -------------------------------------------------------------------------------------


def _check_array(
    name: str, array: Array, length: int | None, dimensions: int | None = None
) -> None:
    if not isinstance(array, np.ndarray):
        kind = type(array).__name__
        raise ValueError(f"{name} is a {kind}, not an array; give np.asarray(…, np.float32) of it")
    if array.dtype != np.float32:
        raise ValueError(f"{name} is {array.dtype}, not float32; give it as .astype(np.float32)")
    if array.ndim == 0 or dimensions not in (None, array.ndim):
        column = "; give it as [:, np.newaxis]" if array.ndim == 1 else ""
        raise ValueError(f"{name} has shape {array.shape}, not (T, channels){column}")
    length = len(array) if length is None else length
    if length == 0:
        raise ValueError(f"{name} has 0 samples; leave such an episode out")
    if len(array) != length:
        raise ValueError(f"{name} has {len(array)} samples, where observation has {length}")
    is_hidden = np.ma.getmaskarray(array)
    is_number = np.isfinite(np.ma.getdata(array)) & ~is_hidden
    if not is_number.all():
        at = np.argwhere(~is_number)[0]
        reason = "masked" if is_hidden[tuple(at)] else "not finite"
        # Without the sample alone, those behind it would be a step early.
        raise ValueError(
            f"{name} is {reason} at sample {at[0]}; end the episode before it, and begin another"
            " behind it"
        )


def _plain(given: Any) -> Any:
    """Numbers that numpy holds in arrays, as Python's own; whatever else was given as it is."""
    if isinstance(given, np.ndarray):
        return given.item() if given.ndim == 0 else _plain(given.tolist())
    return tuple(map(_plain, given)) if isinstance(given, tuple | list) else given


def _check_kinds(made: EpisodeSet) -> None:
    """ValueError for a part of another kind: it would be written, and read by nobody."""
    parts: tuple[tuple[str, Any, type, str], ...] = (
        ("observation", made.observation, Channel, "a tuple of wd.Channel"),
        ("force", made.force, Channel, "a tuple of wd.Channel"),
        ("episodes", made.episodes, Episode, "a tuple of wd.Episode"),
        ("loss_weights", made.loss_weights, numbers.Real, "a tuple of numbers"),
        ("rate_hz", (made.rate_hz,), numbers.Real, "a number"),
        ("window_s", (made.window_s,), numbers.Real, "a number"),
        ("domain", (made.domain,), str, "text"),
        ("split", (made.split,), Mapping, "a dictionary, as {name: 'train'}"),
        ("provenance", (made.provenance,), Mapping, "a dictionary"),
    )
    for label, given, kind, needed in parts:
        is_several = isinstance(given, Sequence) and not isinstance(given, str)
        if not is_several or not all(isinstance(part, kind) for part in given):
            raise ValueError(f"{label} = {getattr(made, label)!r:.60}: give {needed}")
    for channel in (*made.observation, *made.force):
        if not (isinstance(channel.name, str) and isinstance(channel.unit, str)):
            raise ValueError(f"{channel}: name and unit have to be text")
    if not made.domain:
        raise ValueError("domain is empty: give it a name")


def _check_description(made: EpisodeSet) -> None:
    for label, value, high in (("rate_hz", made.rate_hz, 1e5), ("window_s", made.window_s, 1e3)):
        if not (0 < value <= high and math.isfinite(value)):
            raise ValueError(f"{label} = {value}: must lie above 0 and up to {high:g}")
    if whole_steps(made.window_s * made.rate_hz) < 1:
        raise ValueError(
            f"window_s = {made.window_s:g}: is shorter than the {1.0 / made.rate_hz:.4g} s from"
            f" sample to sample, at {made.rate_hz:g} Hz; give at least that"
        )
    for label, channels in (("observation", made.observation), ("force", made.force)):
        names = [channel.name for channel in channels]
        if not names or len(set(names)) < len(names) or "" in names:
            raise ValueError(f"{label} channels {names}: each needs a name of its own")
    if len(made.loss_weights) != len(made.force) or not all(
        math.isfinite(weight) and weight > 0 for weight in made.loss_weights
    ):
        raise ValueError(f"loss_weights = {made.loss_weights}: one positive weight for each force")
    _check_split(made)
    try:
        _canonical(made.provenance)
    except TypeError as error:
        raise ValueError(f"provenance holds what JSON does not ({one_line(error)})") from error


def _check_split(made: EpisodeSet) -> None:
    names = [episode.name for episode in made.episodes]
    if not names or len(set(names)) < len(names):
        raise ValueError(f"{len(names)} episodes named {sorted(set(names))}: need distinct names")
    if set(made.split) != set(names):
        odd = sorted(set(made.split) ^ set(names))[0]
        raise ValueError(f"split: {odd!r} is not both an episode and assigned to a split")
    for name, split in made.split.items():
        if split not in SPLITS:
            raise ValueError(f"split of {name!r} = {split!r}: must be one of {', '.join(SPLITS)}")


def _check_widths(made: EpisodeSet, episode: Episode) -> None:
    for label, array, channels in (
        ("observation", episode.observation, made.observation),
        ("force", episode.force, made.force),
    ):
        if array.shape[1] != len(channels):
            given, needed = array.shape[1], len(channels)
            raise ValueError(f"{label} of {episode.name!r}: {given} columns, {needed} channels")


# --- the folder ---------------------------------------------------------------------------------


class _Record(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class _ChannelEntry(_Record):
    name: str
    unit: str


class _EpisodeEntry(_Record):
    name: str = Field(pattern=f"^{_EPISODE_NAME.pattern}$")
    file: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$")  # a plain name, never a path
    steps: int = Field(gt=0)
    sha256: str


class _Document(_Record):
    schema_version: Literal[1] = Field(alias="schema")
    domain: str
    rate_hz: float
    window_s: float
    observation: list[_ChannelEntry]
    force: list[_ChannelEntry]
    loss_weights: Annotated[tuple[float, ...], Field(strict=False)]
    split: dict[str, str]
    episodes: list[_EpisodeEntry]
    provenance: dict[str, JsonValue]
    sha256: str
    checksum: str


def whole_steps(steps: float) -> int:
    """The floor, forgiving a thousandth of a step: 0.29 s at 100 Hz is 29 steps, not 28.

    Seconds that files state to the microsecond are as many steps as they were.
    """
    return math.floor(steps + 1e-3)


def _canonical(value: Any) -> str:
    return json.dumps(value, sort_keys=True, allow_nan=False, separators=(",", ":"), default=dict)


def _content(made: EpisodeSet) -> dict[str, Any]:
    """What the content hash covers beside the arrays."""
    return {
        "domain": made.domain,
        "rate_hz": float(made.rate_hz),
        "window_s": float(made.window_s),
        "observation": [vars(channel) for channel in made.observation],
        "force": [vars(channel) for channel in made.force],
        "loss_weights": [float(weight) for weight in made.loss_weights],
        "split": dict(made.split),
    }


def _document(made: EpisodeSet, entries: list[dict[str, Any]]) -> dict[str, Any]:
    document = {"schema": SCHEMA} | _content(made)
    document |= {"episodes": entries, "provenance": dict(made.provenance), "sha256": made.sha256}
    return document | {"checksum": _checksum(document)}


def _checksum(document: Mapping[str, Any]) -> str:
    """Hash over the description itself, so that a damaged seed is noticed as well as an array."""
    return sha256_of(_canonical({k: v for k, v in document.items() if k != "checksum"}).encode())


def _write_episode(folder: Path, episode: Episode) -> dict[str, Any]:
    buffer = io.BytesIO()
    np.savez(buffer, **episode.arrays)  # type: ignore[arg-type]
    data = buffer.getvalue()
    digest = sha256_of(data)
    # The hash in the name keeps a new episode from replacing one that the old description lists.
    file = f"{episode.name}-{digest[:12]}.npz"
    write_bytes_whole(folder / file, data)
    return {"name": episode.name, "file": file, "steps": len(episode), "sha256": digest}


def _remove_others(folder: Path, kept: set[str]) -> None:
    """Remove the episodes of a former set, and what a killed writer left."""
    for path in folder.iterdir():
        if path.name not in kept and _OWN_FILE.fullmatch(path.name) and path.is_file():
            path.unlink(missing_ok=True)


def _read_document(path: Path) -> _Document:
    raw = _read_json(path)
    schema = raw.get("schema")
    if isinstance(schema, int) and schema > SCHEMA:
        raise UnusableInput(
            f"{path}: schema {schema} is newer than this wakedeploy reads ({SCHEMA}); upgrade it."
        )
    try:
        document = _Document.model_validate(raw)
        checksum = _checksum(raw)
    except pydantic.ValidationError as error:
        raise UnusableInput(f"{path}: {first_problem(error)}; make the set again.") from error
    except ValueError as error:  # NaN in the provenance
        raise UnusableInput(f"{path}: {one_line(error)}; make the set again.") from error
    if checksum != document.checksum:
        raise UnusableInput(f"{path}: checksum: changed after it was written; make the set again.")
    return document


def _read_json(path: Path) -> dict[str, Any]:
    try:
        raw = json_of(text_of(path))
    except (FileNotFoundError, NotADirectoryError) as error:
        raise UnusableInput(f"{path}: not found; give the folder of an episode set.") from error
    except (OSError, ValueError) as error:
        raise UnusableInput(f"{path}: cannot be read as JSON ({one_line(error)}).") from error
    if not isinstance(raw, dict):
        raise UnusableInput(f"{path}: is not the description of an episode set.")
    return raw


def _read_episode(folder: Path, entry: _EpisodeEntry) -> Episode:
    path = folder / entry.file
    try:
        data = path.read_bytes()
    except OSError as error:
        raise UnusableInput(f"{path}: cannot be read ({error.strerror}); copy it again.") from error
    if sha256_of(data) != entry.sha256:
        raise UnusableInput(f"{path}: damaged, its sha256 is not the one that {DESCRIPTION} lists.")
    try:
        episode = _episode_from(entry.name, data)
    except (ValueError, KeyError) as error:  # damaged, not allowed, or not there
        raise UnusableInput(f"{path}: {one_line(error)}; make the set again.") from error
    if len(episode) != entry.steps:
        raise UnusableInput(
            f"{path}: has {len(episode)} samples, {DESCRIPTION} says {entry.steps}."
        )
    return episode


def _episode_from(name: str, data: bytes) -> Episode:
    arrays = read_archive(data)
    return Episode(name, arrays.pop("observation"), arrays.pop("force"), arrays)
