"""`wakedeploy data`: make, import and describe episode sets."""

import math
import re
import shlex
import tomllib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.data_of_domains import Domains, require_writable, write_set
from wakedeploy.cli.groups import Group
from wakedeploy.cli.output import json_option, print_table, stage_bars, warn, write_json
from wakedeploy.core.errors import UnusableInput, shown
from wakedeploy.core.few_samples import few_samples

if TYPE_CHECKING:
    from wakedeploy.core.episodes import EpisodeSet

_FIRST = 20  # episodes, notes and facts that the terminal shows
_ON_COLUMN = re.compile(r"(?P<log>.+?), (?P<column>column .+?): (?P<said>.*)", re.DOTALL)
_SHARED = 2  # notes of other logs from which on a note stands for all
_COUNTED = ("files", "independent")  # recordings of each split, where a set's provenance says


@click.group(cls=Group)
def command() -> None:
    """Make episodes by simulation, import recordings, describe a set.

    \b
    Example:
        wakedeploy data make gantry --out sets/gantry --minutes 30 --seed 0
        wakedeploy data show sets/gantry
    """


@command.command()
@click.argument("folder", type=click.Path(path_type=Path))
@json_option
def show(folder: Path, json_path: Path | None) -> None:
    """Describe the episode set in FOLDER: splits, channels and their ranges, episodes, provenance.

    Of episodes, notes and provenance the terminal shows the first twenty; --json has all of them.

    \b
    Example:
        wakedeploy data show sets/gantry --json gantry.json
    """
    from wakedeploy.core.episodes import read_episode_set

    described = read_episode_set(folder)
    _describe(described, folder, json_path)
    _list_episodes(described)
    _tell_provenance(described)


def _describe(described: "EpisodeSet", folder: Path, json_path: Path | None) -> None:
    splits, channels = _splits(described), _channels(described)
    title = (
        f"{folder}: {described.domain}, {described.rate_hz:g} Hz, window {described.window_s:g} s"
    )
    shown = ["split", *(n for n in (*_COUNTED, "episodes") if n in splits[0])]
    cells = [[*(str(s[n]) for n in shown), f"{s['seconds']:.1f}"] for s in splits]
    print_table(title, [*shown, "seconds"], cells)
    numbers = ("min", "mean", "sd", "max")
    print_table(
        "channels",
        ["channel", "kind", "unit", *numbers],
        # 0.0 more: a minus zero is 0.
        [
            [c["name"], c["kind"], c["unit"], *(f"{c[n] + 0.0:.4g}" for n in numbers)]
            for c in channels
        ],
    )
    unlearned = _unlearned(described)
    if unlearned:
        print_table(
            "what learns nothing, rms error on the test split",
            ["channel", "unit", "predicting zero", "observer of the sufferer's motion"],
            [[r["name"], r["unit"], f"{r['zero']:.4g}", f"{r['observer']:.4g}"] for r in unlearned],
        )
    few = few_samples({s["split"]: s["scored"] for s in splits if s["split"] != "train"})
    if few:
        warn(few)
    if json_path:
        result = {"domain": described.domain, "rate_hz": described.rate_hz}
        result |= {"window_s": described.window_s, "sha256": described.sha256}
        result |= {"splits": splits, "channels": channels, "unlearned": unlearned}
        result |= {"episodes": _episodes(described)}
        write_json(json_path, result | {"provenance": dict(described.provenance)})


def _list_episodes(described: "EpisodeSet") -> None:
    """The first episodes, each with its split."""
    rows = [[e["name"], e["split"], f"{e['seconds']:.1f}"] for e in _episodes(described)]
    print_table("episodes", ["episode", "split", "seconds"], rows[:_FIRST])
    _tell_more(len(rows), "episodes")


def _tell_provenance(described: "EpisodeSet") -> None:
    """How the set was made, and what was noticed then; of what has parts, how many there are."""
    facts = dict(described.provenance)
    notes = facts.pop("notes", None) or []
    rows = [[shown(name), _fact(value)] for name, value in facts.items()]
    if rows:
        print_table("provenance", ["", ""], rows[:_FIRST])
        _tell_more(len(rows), "facts")
    notes = notes if isinstance(notes, list) else [notes]
    for note in notes[:_FIRST]:
        click.echo(f"Note: {shown(str(note)).rstrip('.')}.")
    _tell_more(len(notes), "notes")


def _fact(value: object) -> str:
    """A fact of the provenance in a cell."""
    if not isinstance(value, dict | list):
        return shown(str(value))
    return f"{len(value)} {'entry' if len(value) == 1 else 'entries'} (--json)"


def _tell_more(count: int, what: str) -> None:
    if count > _FIRST:
        click.echo(f"… and {count - _FIRST} more {what}; --json FILE has all.")


def _episodes(described: "EpisodeSet") -> list[dict[str, Any]]:
    return [
        {
            "name": episode.name,
            "split": described.split[episode.name],
            "seconds": len(episode) / described.rate_hz,
        }
        for episode in described.episodes
    ]


def _splits(described: "EpisodeSet") -> list[dict[str, Any]]:
    from wakedeploy.core.episodes import SPLITS

    parts = {split: described.part(split) for split in SPLITS}
    recordings = _recordings(described)
    lead = described.provenance.get("default_lead_s", 0.0)  # with which it is trained, if no other
    ahead = math.ceil(float(lead) * described.rate_hz) if isinstance(lead, float | int) else 0
    unscored = described.warm_up_steps + ahead
    return [
        {
            "split": split,
            **recordings.get(split, {}),
            "episodes": len(part),
            "seconds": sum(map(len, part)) / described.rate_hz,
            "scored": sum(max(0, len(e) - unscored) for e in part),
        }
        for split, part in parts.items()
    ]


def _recordings(described: "EpisodeSet") -> dict[str, dict[str, int]]:
    """How many recordings each split has; nothing if the provenance does not say all of it."""
    from wakedeploy.core.episodes import SPLITS

    counts: Any = described.provenance.get("recordings")
    try:
        return {split: {name: int(counts[split][name]) for name in _COUNTED} for split in SPLITS}
    except (KeyError, TypeError, ValueError, OverflowError):
        return {}


def _channels(described: "EpisodeSet") -> list[dict[str, Any]]:
    import numpy as np

    rows: list[dict[str, Any]] = []
    for kind, channels in (("observation", described.observation), ("force", described.force)):
        joined = np.concatenate([e.arrays[kind] for e in described.episodes]).astype(float)
        for channel, values in zip(channels, joined.T, strict=True):
            statistics = {"min": values.min(), "mean": values.mean()}
            statistics |= {"sd": values.std(), "max": values.max()}
            rows.append({"name": channel.name, "kind": kind, "unit": channel.unit} | statistics)
    return rows


def _unlearned(described: "EpisodeSet") -> list[dict[str, Any]]:
    """What zero and a set's observer are off by, by force channel; nothing without an observer."""
    import numpy as np

    from wakedeploy.core.episodes import OBSERVER

    test = described.part("test")
    if not test or not all(OBSERVER in e.extras for e in test):
        return []
    force = np.concatenate([e.force for e in test]).astype(float)
    seen = np.concatenate([e.extras[OBSERVER] for e in test]).astype(float)
    zero, off = (np.sqrt(np.mean(e**2, axis=0)) for e in (force, force - seen))
    return [
        {"name": c.name, "unit": c.unit, "zero": float(zero[i]), "observer": float(off[i])}
        for i, c in enumerate(described.force)
    ]


@command.group(cls=Domains, kind="Simulated", describe=_describe)
def make() -> None:
    """Simulate a domain."""


@command.group("import", cls=Domains, kind="Recorded", describe=_describe)
def import_() -> None:
    """Import recordings: logs of your own by `table`, public ones in their original layout."""


@import_.command("table")
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option(
    "--columns",
    "columns_path",
    type=click.Path(dir_okay=False, path_type=Path),
    required=True,
    help="What the columns mean.",
)
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), help="Folder to write.")
@click.option("--guess", is_flag=True, help="Write a first --columns for the first of FILES.")
@click.option(
    "--system",
    "system_path",
    type=click.Path(path_type=Path),
    help="With --guess: FILE.py, or FILE.py:CLASS, with the system whose columns they are.",
)
@json_option
def import_table(
    files: tuple[Path, ...],
    columns_path: Path,
    out: Path | None,
    guess: bool,
    system_path: Path | None,
    json_path: Path | None,
) -> None:
    """Import logs of any system: CSV, Parquet, npz, HDF5, MATLAB, MCAP, rosbag2 or ULog.

    FILES are logs, or folders of files that belong together. The file of --columns says which
    column is which observation or force, its unit, and how time is kept (docs/how-to/own-logs.md).

    \b
    Example:
        wakedeploy data import table axis.csv --guess --columns columns.toml
        wakedeploy data import table axis.csv --guess --system my_robot.py --columns columns.toml
        wakedeploy data import table axis*.csv --columns columns.toml --out sets/axis
    """
    if guess:
        _guess(files, columns_path, system_path)
        return
    if system_path is not None:
        raise click.UsageError("Give --system only with --guess.")
    if out is None:
        raise click.UsageError("Missing option '--out'.")
    from wakedeploy.api.logs import import_table as read

    _require_apart(out, files)
    require_writable(out)
    with stage_bars() as bars:
        made = read(files, columns_path, progress=bars)
    write_set(made, out)
    _describe(made, out, json_path)
    for note in _alike_once(made.provenance.get("notes", ())):  # type: ignore[arg-type]
        warn(f"{note}.")


def _alike_once(notes: Iterable[str]) -> Iterator[str]:
    """Notes of which those on a column that many logs share, but for numbers, stand once."""
    groups: dict[tuple[str, str], list[str]] = {}
    for note in notes:
        found = _ON_COLUMN.match(note)
        key = (found["column"], re.sub(r"\d[\d.]*", "0", found["said"])) if found else (note, "")
        groups.setdefault(key, []).append(note)
    for first, *others in groups.values():
        if len(others) < _SHARED:
            yield from (first, *others)
        else:
            yield f"{first}; {len(others)} more logs are alike, see notes in the set"


def _require_apart(out: Path, files: tuple[Path, ...]) -> None:
    """UnusableInput where a set would be written between the logs, or into one that is a folder."""
    for file in files:
        log = file.resolve()
        if out.resolve() == log:
            where = f"is the log {file} itself"
        elif out.resolve() == log.parent:
            where = f"holds the log {file}"
        elif log in out.resolve().parents:
            where = f"lies in the log {file}, which is a folder"
        else:
            continue
        raise UnusableInput(
            f"{out}: {where}; give --out a folder of its own, so that the set does not lie between"
            " logs."
        )


def _guess(files: tuple[Path, ...], columns_path: Path, system_path: Path | None) -> None:
    """Write a first columns.toml, never over another one."""
    from wakedeploy.api.logs import guess_columns
    from wakedeploy.core.files import begun

    text = guess_columns(files[0], system_path)
    try:
        with begun(columns_path) as path:
            path.write_text(text, "utf-8")
    except FileExistsError as error:
        raise UnusableInput(
            f"{columns_path}: is there already; delete it, or choose another --columns."
        ) from error
    if system_path is None:
        click.echo(
            f"Wrote {columns_path}. Give the columns that you need a role; for `gap`, also the "
            "names of your system, in [columns.NAME]."
        )
    else:
        click.echo(f"Wrote {columns_path}. {_after_guess(text, files, columns_path, system_path)}")


def _after_guess(text: str, files: tuple[Path, ...], columns_path: Path, system_path: Path) -> str:
    """What to do with a first columns.toml of a system's logs."""
    from wakedeploy.api.systems import asked_of_logs, system_of
    from wakedeploy.domains.tables.log_kinds import is_log
    from wakedeploy.gap.wording import listed

    named = tomllib.loads(text)["columns"]  # which may lack a rate or a role: no file to read yet
    lacking = [
        each.name for each in asked_of_logs(system_of(system_path)) if each.name not in named
    ]
    by_hand = f" No column was found for {listed(lacking)}: name them by hand." if lacking else ""
    # Of a folder whose files are alike it is left open which of them are looked at.
    is_one = is_log(files[0]) or any("file" in column for column in named.values())
    logs = [shlex.quote(str(file)) for file in files] if is_one else ["LOG"]
    return (
        f"Look at the lines with a question mark.{by_hand} Then: wakedeploy gap check "
        f"{shlex.quote(str(system_path))} --measured {' '.join(logs)} "
        f"--columns {shlex.quote(str(columns_path))}"
    )
