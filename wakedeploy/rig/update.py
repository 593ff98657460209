"""New values in a rig file that someone has written: its comments and its order stay.

In: a file and constants by dotted name. Out: the same file with `{ value, spread, unit, date }` at
these constants, replaced whole or not at all.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import toml_of, write_text_whole
from wakedeploy.core.locks import one_at_a_time
from wakedeploy.core.rig import Rig
from wakedeploy.rig.file import parse_rig, read_rig_text

_DIGITS = 6
_LONGEST = 4000  # letters of a value that is replaced in its place


@dataclass(frozen=True)
class Calibrated:
    """A constant as it was measured: its value or values, one standard deviation, its unit."""

    value: float | tuple[float, ...]
    spread: float
    unit: str = ""


def update_rig(
    path: Path, constants: Mapping[str, Calibrated], date: str, out: Path | None = None
) -> tuple[Rig, bool]:
    """Write constants, such as "range_sensor.bias_m", into a rig file; the rig that it now is.

    With `out` the file at `path` stays as it is and `out` is written: its own other constants, or
    those of `path` where there is no such file yet.

    The second value is False when the file is written so unusually that it had to be written anew,
    without its comments. Raises UnusableInput for values that the rig's bounds do not allow; the
    file is then as it was.
    """
    out = out or path
    # Of two calibrations that end in one moment, the second would take the first one's value away.
    with one_at_a_time(out.parent, out.name, traceless=True):
        source = out if out.exists() else path
        text = read_rig_text(source)
        rig = parse_rig(text, str(source))
        try:
            wanted = updated(rig, constants, date)
        except UnusableInput as error:
            raise UnusableInput(f"{out}: not changed, for of the {error}") from error
        for name, known in constants.items():
            text = _with_constant(text, name, _inline(known, date))
        kept = _reads_as(text, wanted)
        write_text_whole(out, text if kept else wanted.text)
        return wanted, kept


def updated(rig: Rig, constants: Mapping[str, Calibrated], date: str) -> Rig:
    """The rig with these constants; UnusableInput names the one that is out of bounds."""
    for name, known in constants.items():
        *sections, key = name.split(".")
        entry: dict[str, object] = {"value": _rounded(known.value), "spread": _short(known.spread)}
        entry |= ({"unit": known.unit} if known.unit else {}) | {"date": date}
        change: dict[str, object] = {key: entry}
        for section in reversed(sections[1:]):
            change = {section: change}
        rig = rig.changed(**{sections[0]: change})
    return rig


def _reads_as(text: str, wanted: Rig) -> bool:
    try:
        return parse_rig(text) == wanted
    except UnusableInput:
        return False


def _with_constant(text: str, name: str, inline: str) -> str:
    """The text with one constant replaced, or added at the end of its section."""
    section, key = name.rsplit(".", 1)
    lines = text.splitlines()
    header = re.compile(rf"\s*\[\s*{re.escape(section)}\s*\]\s*(#.*)?$")
    start = next((i for i, line in enumerate(lines) if header.match(line)), None)
    if start is None:
        return text.rstrip("\n") + f"\n\n[{section}]\n{key} = {inline}\n"
    end = next((i for i in range(start + 1, len(lines)) if re.match(r"\s*\[", lines[i])), None)
    stop = len(lines) if end is None else end
    for at in range(start + 1, stop):
        if re.match(rf"\s*{re.escape(key)}\s*=", lines[at]):
            last, comment = _extent(lines, at)
            lines[at : last + 1] = [f"{key} = {inline}{comment}"]
            return "\n".join(lines) + "\n"
    filled = [i for i in range(start, stop) if lines[i].split("#")[0].strip()]
    lines.insert(filled[-1] + 1, f"{key} = {inline}")
    return "\n".join(lines) + "\n"


def _extent(lines: list[str], at: int) -> tuple[int, str]:
    """The last line of the value that begins at line `at`, and the comment behind it.

    Of one that goes on for ever, the first line: what comes of it is then no rig file.
    """
    for last in range(at, len(lines)):
        whole = "\n".join(lines[at : last + 1])
        if len(whole) > _LONGEST:
            break
        if not _is_toml(whole):
            continue
        marks = [i for i, letter in enumerate(lines[last]) if letter == "#"]
        before = "\n".join([*lines[at:last], ""])
        for mark in marks:  # the first one behind which everything may be left out
            if _is_toml(before + lines[last][:mark]):
                return last, "  " + lines[last][mark:]
        return last, ""
    return at, ""


def _is_toml(text: str) -> bool:
    try:
        return bool(toml_of(text))
    except ValueError:
        return False


def _inline(known: Calibrated, date: str) -> str:
    value = _rounded(known.value)
    shown = f"[{', '.join(map(repr, value))}]" if isinstance(value, list) else repr(value)
    unit = f', unit = "{known.unit}"' if known.unit else ""
    return f'{{ value = {shown}, spread = {_short(known.spread)!r}{unit}, date = "{date}" }}'


def _rounded(value: float | tuple[float, ...]) -> float | list[float]:
    return [_short(each) for each in value] if isinstance(value, tuple) else _short(value)


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
