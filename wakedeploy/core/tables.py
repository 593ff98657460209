"""Run logs and episode sets as tables for other programs: Parquet or MATLAB's .mat; logs as CSV.

In: a `RunLog` or an `EpisodeSet`. Out: one file. Parquet needs pyarrow, which comes with
`wakedeploy[tables]`; .mat needs what wakedeploy needs in any case.
"""

import json
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from wakedeploy.core.episodes import Episode, EpisodeSet
from wakedeploy.core.errors import UnusableInput, installs
from wakedeploy.core.files import write_whole
from wakedeploy.core.runlog import RunLog
from wakedeploy.core.runlog_columns import COLUMN

Array = npt.NDArray[Any]
KINDS = (".parquet", ".mat")
LOG_KINDS = (".csv", *KINDS)
LONGEST_NAME = 31  # that every version of the .mat format takes


def require_kind(path: Path, kinds: Sequence[str] = KINDS) -> str:
    """The file's kind by its name; UnusableInput for any other than `kinds`."""
    kind = path.suffix.lower()
    if kind not in kinds:
        endings = f"{', '.join(kinds[:-1])} or {kinds[-1]}"
        raise UnusableInput(f"{path}: give the output a name that ends in {endings}.")
    if kind == ".parquet":
        _pyarrow()
    return kind


def write_log(log: RunLog, path: Path) -> None:
    """A run log: one row per tick, missing values as null (Parquet), NaN (.mat) or empty (CSV).

    CSV has the run's metadata in a file beside it. Parquet keeps them as text, and each column's
    unit; .mat has one variable per column and the structs `units` and `metadata`.
    """
    units = {name: COLUMN[name].unit for name in log.columns}
    kind = require_kind(path, LOG_KINDS)
    if kind == ".csv":
        log.write_csv(path)
        return
    if kind == ".parquet":
        columns = {name: _log_column(name, values) for name, values in log.columns.items()}
        _write_parquet(path, columns, units, log.metadata)
        return
    variables = {name: _as_cells(values) for name, values in log.columns.items()}
    facts = {"units": _named(units), "metadata": _named(log.metadata)}
    _write_mat(path, _named(variables) | facts)


def write_set(made: EpisodeSet, path: Path) -> None:
    """An episode set: in Parquet one row per sample with the episode's name, in .mat one struct.

    Parquet's columns are episode, split, sample, t_s, then observation, force and extra channels;
    .mat holds a cell array of structs `episodes` and the channels' names and units.
    """
    if require_kind(path) == ".parquet":
        columns, units = _set_columns(made)
        _write_parquet(path, columns, units, _about(made))
        return
    episodes = np.empty((1, len(made.episodes)), dtype=object)
    for i, episode in enumerate(made.episodes):
        facts = {"name": episode.name, "split": made.split[episode.name]}
        episodes[0, i] = _named(facts | dict(episode.arrays))
    variables: dict[str, Any] = {"episodes": episodes, "rate_hz": made.rate_hz}
    for kind, channels in (("observation", made.observation), ("force", made.force)):
        variables[f"{kind}_names"] = _as_cells(np.array([c.name for c in channels], dtype=object))
        variables[f"{kind}_units"] = _as_cells(np.array([c.unit for c in channels], dtype=object))
    _write_mat(path, variables | {"metadata": _named(_about(made))})


def matlab_names(names: list[str]) -> dict[str, str]:
    """Names as MATLAB takes them: letters, digits and _, at most 31, each different."""
    given: dict[str, str] = {}
    for name in names:
        plain = re.sub(r"\W", "_", name, flags=re.ASCII)
        plain = plain if re.match(r"[A-Za-z]", plain) else f"x{plain}"
        short, count = plain[:LONGEST_NAME], 2
        while short in given.values():
            ending = f"_{count}"
            short, count = plain[: LONGEST_NAME - len(ending)] + ending, count + 1
        given[name] = short
    return given


def _named(variables: Mapping[str, Any]) -> dict[str, Any]:
    names = matlab_names(list(variables))
    return {names[name]: value for name, value in variables.items()}


def _as_cells(values: Array) -> Array:
    """A column of numbers (T, 1), or of texts as a cell array (T, 1)."""
    return values.reshape(-1, 1)


def _log_column(name: str, values: Array) -> Array:
    """A column with None for missing, as Parquet takes it; whole numbers as such."""
    if COLUMN[name].kind == "text":
        return values
    if COLUMN[name].kind == "integer":
        whole = [None if value != value else int(value) for value in values]
        return np.array(whole, dtype=object)
    return np.array([None if value != value else value for value in values], dtype=object)


def _about(made: EpisodeSet) -> dict[str, str]:
    return {
        "domain": made.domain,
        "rate_hz": f"{made.rate_hz:g}",
        "window_s": f"{made.window_s:g}",
        "sha256": made.sha256,
        "provenance": json.dumps(dict(made.provenance), default=dict),
    }


def _set_columns(made: EpisodeSet) -> tuple[dict[str, Array], dict[str, str]]:
    """All episodes end to end, and the units of the channels."""
    extras = {name: a for e in made.episodes for name, a in e.extras.items()}
    tables = [_episode_columns(made, episode, extras) for episode in made.episodes]
    columns = {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
    units = {c.name: c.unit for c in (*made.observation, *made.force)}
    return columns, {name: units.get(name, "") for name in columns} | {"t_s": "s"}


def _episode_columns(
    made: EpisodeSet, episode: Episode, extras: Mapping[str, Array]
) -> dict[str, Array]:
    count = len(episode)
    columns: dict[str, Array] = {
        "episode": np.full(count, episode.name, dtype=object),
        "split": np.full(count, made.split[episode.name], dtype=object),
        "sample": np.arange(count),
        "t_s": np.arange(count) / made.rate_hz,
    }
    for channels, array in ((made.observation, episode.observation), (made.force, episode.force)):
        columns |= {c.name: array[:, i] for i, c in enumerate(channels)}
    for name, example in extras.items():
        missing = np.full((count, *example.shape[1:]), np.nan, dtype=np.float32)
        flat = episode.extras.get(name, missing).reshape(count, -1)
        names = [name] if flat.shape[1] == 1 else [f"{name}_{i}" for i in range(flat.shape[1])]
        columns |= {_free(n, columns): flat[:, i] for i, n in enumerate(names)}
    return columns


def _free(name: str, taken: Mapping[str, Any]) -> str:
    """A column's name, set apart from a channel that has it already."""
    return f"extra_{name}" if name in taken else name


def _write_parquet(
    path: Path, columns: Mapping[str, Array], units: Mapping[str, str], about: Mapping[str, str]
) -> None:
    arrow, parquet = _pyarrow()
    fields, arrays = [], []
    for name, values in columns.items():
        array = arrow.array(values.tolist() if values.dtype == object else values)
        if str(array.type) == "null":  # nothing was recorded in it
            array = array.cast(arrow.float64())
        arrays.append(array)
        fields.append(arrow.field(name, array.type, metadata={"unit": units.get(name, "")}))
    table = arrow.table(arrays, schema=arrow.schema(fields, metadata=dict(about)))
    _written(path, lambda temporary: parquet.write_table(table, temporary))


def _write_mat(path: Path, variables: Mapping[str, Any]) -> None:
    from scipy.io import savemat

    _written(path, lambda temporary: savemat(temporary, dict(variables), do_compression=True))


def _written(path: Path, write: Callable[[str], None]) -> None:
    write_whole(path, lambda temporary: write(str(temporary)))


def _pyarrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ModuleNotFoundError as error:
        raise UnusableInput(
            f"pyarrow is not installed, which Parquet needs: {installs('tables')}; or give the"
            " output a name that ends in .mat."
        ) from error
    return pyarrow, pyarrow.parquet
