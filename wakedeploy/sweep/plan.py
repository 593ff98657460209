"""What a sweep is asked for: a plan in TOML, or the same from command-line options.

Wherever a training has a value it may have a list, which means each of its values; what is
simulated for it is said one set at a time.
"""

import dataclasses
import itertools
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, TypeVar

import pydantic
from pydantic import BeforeValidator, Field

from trainers.bounds import check_settings
from trainers.build import ARCHITECTURES, hyper_parameters
from trainers.preset import REFERENCE, TUNED, read_preset
from trainers.training.fit import FitSettings
from wakedeploy.core.episodes import DESCRIPTION
from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.files import text_of, toml_of
from wakedeploy.core.names import ALL, domains, meant
from wakedeploy.core.validation import first_problem
from wakedeploy.sweep.generate import Generate, checked

Place = tuple[str | int, ...]  # of a value in the plan, as pydantic reports it
Where = Callable[[Place], str]  # what an error about that place begins with


@dataclass(frozen=True)
class Choice:
    """What one training job of a plan is asked for, the set aside; `lead_s` None: as it states."""

    arch: str
    seed: int
    lead_s: float | None
    settings: Mapping[str, Any]
    hyper: Mapping[str, Any]
    preset: str = REFERENCE  # what settings and hyper change; for some domain, or a file


@dataclass(frozen=True)
class Plan:
    """A checked plan: what to generate, what to train on (`data` by name: folder), the choices.

    `data` None stands for a set that the plan itself generates under that name.
    """

    data: Mapping[str, Path | None]
    choices: tuple[Choice, ...]
    generate: tuple[Generate, ...]

    @property
    def jobs(self) -> int:
        """How many jobs there are, generated sets included."""
        return len(self.generate) + len(self.data) * len(self.choices)


def read_plan(path: Path | None, options: Mapping[str, Any] | None = None) -> Plan:
    """A plan from its file, from options of the same names, or from both: options come first.

    Folders in a file are relative to it, those of options to where we are. Raises UnusableInput
    with file, line and reason, or with the option.
    """
    text, raw = _file(path) if path else ("", {})
    given = dict(options or {})

    def where(place: Place) -> str:
        if place and _within(given, place):
            name = place[1] if place[0] == "settings" and len(place) > 1 else place[0]
            value = ".".join(map(str, place[1:])) if place[0] == "hyper" else ""
            return f"--{str(name).replace('_', '-')} {value}".rstrip() + ": "
        line = line_of(text, place)
        return f"{path}, line {line}: " if line else f"{path}: " if path else ""

    base = path.parent if path else Path()
    beside = {name: Path() if name in given else base for name in ("data", "preset")}
    return _checked_plan(_merged(raw, given), base, beside, where)


def line_of(text: str, place: Place) -> int | None:
    """The line, counted from 1, where a value of a TOML document stands, or the table it is not in.

    None if neither is found.
    """
    lines, found = text.splitlines(), None
    for i, part in enumerate(place):
        if isinstance(part, int):
            continue
        hits = list(_lines_of(lines, part, found or 0))
        if not hits:
            break
        index = place[i + 1] if i + 1 < len(place) else 0  # of [[…]], which entry
        entries = [n for n in hits if _is_head(lines[n], "[[")]
        several = isinstance(index, int) and entries
        found = entries[min(int(index), len(entries) - 1)] if several else hits[0]
    return None if found is None else found + 1


def _lines_of(lines: Sequence[str], name: str, first: int) -> Iterator[int]:
    """Lines from `first` on that head a table of this name, or set it before the next table."""
    name = re.escape(name)
    head = re.compile(rf'\s*\[\[?\s*([\w."-]*\.)?"?{name}"?\s*[\].]')
    value = re.compile(rf'(\s*|.*[{{,.]\s*)"?{name}"?\s*[=.]')
    in_first_table = True
    for n in range(first, len(lines)):
        if _is_head(lines[n]):
            in_first_table = in_first_table and n == first
            if head.match(lines[n]):
                yield n
        elif in_first_table and value.match(lines[n]):
            yield n


def _is_head(line: str, bracket: str = "[") -> bool:
    return line.lstrip().startswith(bracket)


def _checked_plan(
    raw: Mapping[str, Any], base: Path, beside: Mapping[str, Path], where: Where
) -> Plan:
    """A plan from its values; rig files are relative to `base`, sets and presets to `beside`'s.

    Raises UnusableInput, which begins with what `where` says of the value's place.
    """
    try:
        document = _Document.model_validate(dict(raw))
    except pydantic.ValidationError as error:
        place = error.errors()[0]["loc"]
        problem = f"{where(place)}{first_problem(error)}"
        if error.errors()[0]["type"] == "extra_forbidden":
            known = _Generate if place[0] == "generate" else _Document
            problem += f"; known are {', '.join(known.model_fields)}"
        raise UnusableInput(f"{problem}.") from error
    generate = [
        checked(Generate(**entry.model_dump()), base, lambda *at, i=i: where(("generate", i, *at)))
        for i, entry in enumerate(document.generate)
    ]
    names = [entry.name for entry in generate]
    for i, name in enumerate(names):
        if name in names[:i]:
            raise UnusableInput(
                f"{where(('generate', i, 'name'))}two sets are named '{name}'; rename one."
            )
    trains = document.model_fields_set - {"data", "generate"}
    if not document.data and (trains or not generate):
        what = f"has {', '.join(sorted(trains))} but no data" if trains else "asks for nothing"
        raise UnusableInput(f"{where(())}the plan {what}; name sets to train on (--data).")
    data = _data(document, names, beside["data"], where)
    choices = tuple(_choices(document, beside["preset"], where)) if data else ()
    return Plan(data, choices, tuple(generate))


def _file(path: Path) -> tuple[str, dict[str, Any]]:
    try:
        text = text_of(path)
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or one_line(error)
        raise UnusableInput(f"{path}: cannot be read as a plan ({why}).") from error
    try:
        return text, _spelled(toml_of(text))
    except ValueError as error:
        raise UnusableInput(f"{path}: not valid TOML: {one_line(error)}.") from error


def _spelled(document: dict[str, Any]) -> dict[str, Any]:
    """The document with architectures and domains as they are spelled here."""
    spelled = dict(document)
    if "arch" in spelled:
        spelled["arch"] = [_name(name, (ALL, *ARCHITECTURES)) for name in _listed(spelled["arch"])]
    if isinstance(spelled.get("hyper"), dict):
        spelled["hyper"] = {
            _name(arch, ARCHITECTURES): given for arch, given in spelled["hyper"].items()
        }
    for entry in _listed(spelled.get("generate", ())):
        if isinstance(entry, dict) and "domain" in entry:
            entry["domain"] = _name(entry["domain"], domains())
    return spelled


def _name(given: Any, names: Iterable[str]) -> Any:
    return meant(given, names) or given if isinstance(given, str) else given


def _merged(below: Mapping[str, Any], above: Mapping[str, Any]) -> dict[str, Any]:
    """Two documents in one; where both have a value it is `above`'s."""
    merged = dict(below)
    for name, value in above.items():
        both = isinstance(value, Mapping) and isinstance(merged.get(name), Mapping)
        merged[name] = _merged(merged[name], value) if both else value
    return merged


def _within(document: Mapping[str, Any], place: Place) -> bool:
    """Whether a document has a value at or above this place."""
    held: Any = document
    for part in place:
        if not isinstance(held, Mapping):
            return True
        if part not in held:
            return False
        held = held[part]
    return True


Value = TypeVar("Value")


def _listed(value: Any) -> Any:
    return tuple(value) if isinstance(value, list | tuple) else (value,)


Several = Annotated[tuple[Value, ...], BeforeValidator(_listed), Field(min_length=1)]


class _Table(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


class _Generate(_Table):
    name: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,99}$")
    domain: str
    minutes: float = Field(ge=0.1, le=10_000)
    seed: int = Field(default=0, ge=0)
    settings: dict[str, Any] = {}


class _Document(_Table):
    data: Several[str] = ()
    arch: Several[str] = ("all",)
    seeds: int = Field(default=1, ge=1, le=1000)
    lead: Several[Annotated[float, Field(ge=0, le=10)]] = ()
    preset: Several[str] = (REFERENCE,)
    settings: dict[str, Several[Any]] = {}
    hyper: dict[str, dict[str, Several[Any]]] = {}
    generate: Annotated[tuple[_Generate, ...], BeforeValidator(_listed)] = ()


def _data(
    document: _Document, generated: list[str], sets: Path, where: Where
) -> dict[str, Path | None]:
    found: dict[str, Path | None] = {}
    for name in document.data:
        folder = sets / name
        if name not in generated and not _is_file(folder / DESCRIPTION):
            made = f" and none of its own sets ({', '.join(generated)})" if generated else ""
            raise UnusableInput(
                f"{where(('data',))}'{name}' is no folder with an episode set{made}; make one with"
                " `wakedeploy data`, or with [[generate]]."
            )
        found[name] = None if name in generated else folder
    return found


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long to be one
        return False


def _choices(document: _Document, presets_in: Path, where: Where) -> Iterator[Choice]:
    archs = _architectures(document.arch, where)
    presets = _presets(document.preset, archs, presets_in, where)
    _check_settings(document.settings, where)
    for arch in document.hyper:
        if arch not in archs:
            raise UnusableInput(
                f"{where(('hyper', arch))}'{arch}' is not among the architectures of this sweep"
                f" ({', '.join(archs)})."
            )
    leads: tuple[float | None, ...] = tuple(map(float, document.lead)) or (None,)
    for arch in archs:
        hypers = list(_hypers(arch, document.hyper.get(arch, {}), where))
        every = itertools.product(presets[arch], leads, _grid(document.settings), hypers)
        for preset, lead_s, settings, hyper in every:
            for seed in range(document.seeds):
                yield Choice(arch, seed, lead_s, settings, hyper, preset)


def _presets(
    asked: tuple[str, ...], archs: list[str], folder: Path, where: Where
) -> dict[str, list[str]]:
    """The presets of each architecture: a file is of one, what has a name of all."""
    found: dict[str, list[str]] = {arch: [] for arch in archs}
    for name in dict.fromkeys(asked):
        if name in (REFERENCE, TUNED):
            for presets in found.values():
                presets.append(name)
            continue
        try:
            arch = read_preset(folder / name).arch
        except UnusableInput as error:
            raise UnusableInput(f"{where(('preset',))}{error}") from error
        if arch not in found:
            raise UnusableInput(
                f"{where(('preset',))}'{name}' is a preset of {arch}, which is not among the"
                f" architectures of this sweep ({', '.join(archs)})."
            )
        found[arch].append(str(folder / name))
    without = [arch for arch, presets in found.items() if not presets]
    if without:
        raise UnusableInput(
            f"{where(('preset',))}none of these is a preset of {', '.join(without)}; add"
            f" '{REFERENCE}', or leave out what has none."
        )
    return found


def _architectures(asked: tuple[str, ...], where: Where) -> list[str]:
    if asked == ("all",):
        return list(ARCHITECTURES)
    for name in asked:
        if name not in ARCHITECTURES:
            raise UnusableInput(
                f"{where(('arch',))}'{name}' is no architecture; choose all or"
                f" {', '.join(ARCHITECTURES)}."
            )
    return list(dict.fromkeys(asked))


def _hypers(
    arch: str, asked: Mapping[str, tuple[Any, ...]], where: Where
) -> Iterator[dict[str, Any]]:
    known = [field.name for field in dataclasses.fields(ARCHITECTURES[arch].hyper)]
    for name in asked:
        if name not in known:
            raise UnusableInput(
                f"{where(('hyper', arch, name))}{arch} has no hyper-parameter '{name}'; it has"
                f" {', '.join(known)}."
            )
    for values in _grid(asked):
        try:
            hyper_parameters(arch, values)
        except UnusableInput as error:
            place = ("hyper", arch, *(asked if len(asked) == 1 else ()))
            raise UnusableInput(f"{where(place)}{error}") from error
        yield values


def _check_settings(asked: Mapping[str, tuple[Any, ...]], where: Where) -> None:
    usual = dataclasses.asdict(FitSettings())
    for name, values in asked.items():
        for value in values:
            try:
                check_settings(usual, {name: value})
            except UnusableInput as error:
                raise UnusableInput(f"{where(('settings', name))}{error}") from error


def _grid(values: Mapping[str, tuple[Any, ...]]) -> list[dict[str, Any]]:
    """Every combination of one value of each, the last name varying fastest."""
    return [
        dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*values.values())
    ]
