"""`columns.toml`: what the columns of a log mean. Read and checked here and nowhere else.

The columns of a run log are in `wakedeploy.core.runlog_columns`.

In: a TOML file. Out: `Columns`. What each entry does is said at its field below, and for people in
docs/how-to/own-logs.md.
"""

import difflib
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import pydantic
from pydantic import AfterValidator, Field, StringConstraints

from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.files import text_of, toml_of
from wakedeploy.core.validation import first_problem

VERSION = 1
Role = Literal["input", "output", "observation", "force", "unused"]
Angle = Literal["yaw", "pitch", "roll"]
Method = Literal["hold", "low-pass"]
Ahead = Literal["interpolate", "average"]


def _channel_name(name: str) -> str:
    if re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,63}", name) is None:
        raise ValueError("a name is a letter, then up to 63 letters, digits and _")
    return name


def _set_name(name: str) -> str:
    if re.fullmatch(r"[a-z][a-z0-9-]{0,40}", name) is None:
        raise ValueError("a name is a small letter, then up to 40 small letters, digits and -")
    return name


Name = Annotated[str, AfterValidator(_channel_name)]
Address = Annotated[str, StringConstraints(min_length=1, max_length=300)]
_MOST_HZ = 1e5
_LARGEST_SHIFT_S = 1e10  # three hundred years: between a clock since 1970 and one since a start


class _Table(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class TimeBase(_Table):
    """When samples were taken: by a column of stamps, or by a rate where a log has none."""

    column: Address | None = None
    """The column of stamps; None for the log's own clock (ULog, MCAP, rosbag2) or for a rate."""
    unit: str | None = None
    """The unit of the stamps; by default seconds, or what the log's own clock counts in."""
    nanoseconds: Address | None = None
    """The column of nanoseconds beyond the whole seconds of `column`, as ROS has its stamps."""
    format: str | None = None
    """How stamps that are texts are written, as `strptime` takes it, or "iso"."""
    rate_hz: float | None = Field(default=None, ge=0, le=_MOST_HZ)
    """Samples a second of a log without stamps; a first file has 0 where the log does not say."""
    repeated: Literal["last", "first", "refuse"] = "last"
    """Which of several numbers that a column has at one stamp is kept."""
    falling: Literal["refuse", "sort", "split"] = "refuse"
    """Stamps that fall: refused, sorted, or the begin of another recording."""
    wraps_at: float | None = Field(default=None, gt=0)
    """The counts, in `unit`, after which a counter begins again, as 4294967296 of 32 bits."""

    @pydantic.model_validator(mode="after")
    def _one_source(self) -> "TimeBase":
        if self.rate_hz is not None and self.column is not None:
            raise ValueError("give either a column of stamps or a rate_hz, not both")
        if self.nanoseconds is not None:
            if self.column is None or self.format is not None:
                raise ValueError("nanoseconds are for whole seconds in `column`, without a format")
            if self.unit not in (None, "s"):
                raise ValueError('nanoseconds are for whole seconds in `column`: unit = "s"')
        if self.wraps_at is not None and (self.format or self.nanoseconds or self.rate_hz):
            raise ValueError("wraps_at is of stamps in one column that count; delete it")
        if self.rate_hz == 0.0:
            raise ValueError("rate_hz is still 0: give the samples a second, or a column of stamps")
        return self


class Resampling(_Table):
    """The even rate that all columns are brought to; without this table samples stay as they are.

    A force may have a way of its own, see `Column.resample`.

    "hold" takes the newest sample at or before each tick. "low-pass" filters what is held by a
    second-order Butterworth filter that knows no later sample, for every column alike.
    """

    rate_hz: float = Field(gt=0, le=_MOST_HZ)
    method: Method = "hold"
    cutoff_hz: float | None = Field(default=None, gt=0)
    """The cut-off [Hz] of the low-pass filter; by default a quarter of the rate."""

    @pydantic.model_validator(mode="after")
    def _cutoff_below_half(self) -> "Resampling":
        if self.cutoff_hz is not None and self.method == "hold":
            raise ValueError('cutoff_hz is of method = "low-pass"')
        if self.cutoff_hz is not None and self.cutoff_hz > 0.45 * self.rate_hz:
            raise ValueError("cutoff_hz has to lie below 0.45 of rate_hz")
        return self

    @property
    def effective_cutoff_hz(self) -> float:
        """The cut-off that is used."""
        return self.cutoff_hz or self.rate_hz / 4.0


class Splitting(_Table):
    """Where a recording ends within a file."""

    gap_s: float | None = Field(default=None, gt=0)
    """A silence that is longer ends a recording; None: files are not split, silence is refused."""
    shortest_s: float = Field(default=0.0, ge=0)
    """Pieces that are shorter are left out."""


Encoding = Literal["utf-8-sig", "utf-8", "ascii", "latin-1", "cp1252", "utf-16"]


class Delimited(_Table):
    """How a CSV file is written, where it cannot be seen from its first line."""

    delimiter: Annotated[str, StringConstraints(min_length=1, max_length=1)] | None = None
    """None: whichever of comma, semicolon, tab and blank the first line has."""
    decimal: Literal[".", ","] = "."
    thousands: Literal[".", ",", "'"] | None = None
    """What parts the thousands of a number, as in 1,234.5."""
    units_in_cells: bool = False
    """Whether numbers have a unit behind them, as in 0.02 sec, one all through a column."""
    names_in_cells: bool = False
    """Whether each number has its name before it, as in angle:1.5 or angle=1.5."""
    header: bool = True
    """Without a header columns are called #1, #2 and so on; with one these names work, too."""
    units_row: bool = False
    """Whether the row below the header holds units."""
    more_rows: int = Field(default=0, ge=0, le=100)
    """Rows below the header, and below the units, that hold no data either."""
    skip_rows: int = Field(default=0, ge=0, le=10_000)
    """Lines before the header."""
    comment: str | None = None
    """What lines that are left out begin with; those before the header with # in any case."""
    encoding: Encoding = "utf-8-sig"

    @pydantic.model_validator(mode="after")
    def _named_cells_alone(self) -> "Delimited":
        if self.names_in_cells:
            plain = {"names_in_cells", "skip_rows", "comment", "encoding"}
            beside = [n for n in self.model_dump(exclude_defaults=True) if n not in plain]
            if beside:
                raise ValueError(f"names_in_cells goes without {beside[0]}; delete one of them")
        return self


class Training(_Table):
    """What an episode set needs beside the columns."""

    name: Annotated[str, AfterValidator(_set_name)] = "table"
    """What the set is called in run folders and packages."""
    window_s: float = Field(default=0.5, gt=0, le=1e3)
    """The history that a window model sees."""
    lead_s: float = Field(default=0.0, ge=0, le=3600)
    """How far ahead the force is that `train` asks for, where it is not told another lead."""
    held_out: Literal["files", "time"] | None = None
    """What validation and test are: whole files, or the last 30 % of each recording.

    None: files where there are at least three.
    """
    validation: tuple[Address, ...] = ()
    test: tuple[Address, ...] = ()
    """Patterns of file names, or of paths as `d1/*`; a split without one is drawn from the rest."""
    loss_weights: Mapping[Name, Annotated[float, Field(gt=0)]] = {}
    """By the name of the force; 1 where nothing is said."""


class Column(_Table):
    """One column: where it stands in the log, what it is, and its unit.

    A number in the system is (number in the log × scale + offset), in `unit`, converted to `to`.
    """

    column: Address | None = None
    """Its name in the log; `state_positions[2]` is the third number of a vector."""
    quaternion: tuple[Address, Address, Address, Address] | None = None
    """Instead of `column`: the names of x, y, z and w of an orientation, of which one angle is."""
    angle: Angle | None = None
    """Which angle of the quaternion: about z, then y, then x."""
    role: Role | tuple[Role, ...]
    unit: str
    """What the log's numbers are in; "1" for none."""
    to: str | None = None
    """What they become; the SI unit of the same dimension where nothing is said."""
    scale: float = 1.0
    offset: float = 0.0
    absent: tuple[float, ...] = ()
    """Numbers of the log that stand for "no reading", as -999: there is no number there."""
    missing: Literal["refuse", "hold", "nan", "split"] = "refuse"
    """A sample without a number: refused, the last one held, NaN, or the end of a recording.

    A reading that is held is not measured: there "hold" says that rows of other columns lie between
    its own.
    """
    resample: Ahead | None = None
    """How a force is brought to the rate, where that is not the `method` of all columns.

    "interpolate" is for a force that is slower than the rate, "average" over the tick for a faster
    one. Both know later samples, as what is learnt may, and what is seen may not.
    """
    wraps: bool | None = None
    """Whether an angle begins again after a turn, which is then taken out; False leaves it.

    None: an output that jumps as such an angle does is unwrapped, unless it is learnt from, too.
    """
    event: bool = False
    """Written only when it changes: its last sample holds for as long as the others go on."""
    time: Address | None = None
    """Its own column of stamps, where [time] is that of others."""
    time_unit: str | None = None
    shift_s: float = Field(default=0.0, ge=-_LARGEST_SHIFT_S, le=_LARGEST_SHIFT_S)
    """Added to its stamps: where its clock is another, or it is known to come late (then < 0)."""
    file: Address | None = None
    """The file within a folder, where a recording is a folder of files."""

    @pydantic.model_validator(mode="before")
    @classmethod
    def _angle_in_rad(cls, raw: Any) -> Any:
        """What is computed here has its unit from here."""
        if isinstance(raw, dict) and "quaternion" in raw:
            return {"unit": "rad"} | raw
        return raw

    @pydantic.model_validator(mode="after")
    def _ahead_only_of_a_force(self) -> "Column":
        if self.resample is not None and set(self.roles) - {"unused"} != {"force"}:
            raise ValueError(
                f'resample = "{self.resample}" knows later samples, which only a force may: give'
                ' role = "force" alone, or delete resample'
            )
        if self.resample is not None and (self.missing == "nan" or self.event):
            raise ValueError(
                f'resample = "{self.resample}" needs numbers on both sides; delete event, and'
                ' missing = "nan"'
            )
        return self

    @pydantic.model_validator(mode="after")
    def _one_place(self) -> "Column":
        if self.quaternion is None:
            if self.column is None:
                raise ValueError("column is missing")
            if self.angle is not None:
                raise ValueError("angle is of a quaternion, and none is given; delete it")
            return self
        if self.column is not None:
            raise ValueError("give either column or quaternion, not both")
        if self.angle is None:
            raise ValueError('give the angle of the quaternion: "yaw", "pitch" or "roll"')
        if self.unit != "rad":
            raise ValueError(f'the angle of a quaternion is in rad; give to = "{self.unit}"')
        ends = "".join(address[-1].lower() for address in self.quaternion)
        if sorted(ends) == sorted("xyzw") and ends != "xyzw":
            raise ValueError("give the quaternion in the order x, y, z, w")
        return self

    @property
    def addresses(self) -> tuple[str, ...]:
        """Where its numbers stand in the log: one column, or the four of a quaternion."""
        return (self.column,) if self.column is not None else self.quaternion or ()

    @property
    def address(self) -> str:
        """What it is called in sentences: "yaw of /imu.orientation" for an angle."""
        if self.quaternion is None:
            return self.column or ""
        stem = self.quaternion[0][:-1].rstrip("._/[")
        is_common = stem and all(part.startswith(stem) for part in self.quaternion)
        return f"{self.angle} of {stem if is_common else ', '.join(self.quaternion)}"

    @property
    def roles(self) -> tuple[Role, ...]:
        """All of its roles."""
        return self.role if isinstance(self.role, tuple) else (self.role,)

    @property
    def is_reading(self) -> bool:
        """Whether it counts only where it was measured: an output, and nothing else beside it.

        What drives the system, and what is learnt from, has a value at all times. So has what is
        written only when it changes.
        """
        return self._is_output_alone and not self.event

    @property
    def goes_on(self) -> bool:
        """Whether an angle that begins again after a turn shall go on instead.

        What a predictor sees in flight begins again there, too, and a command may truly jump.
        """
        return self._is_output_alone if self.wraps is None else self.wraps

    @property
    def _is_output_alone(self) -> bool:
        return set(self.roles) - {"unused"} == {"output"}


class Columns(_Table):
    """A whole `columns.toml`; `columns` by the name that each has in the system or the set."""

    version: Literal[1]
    time: TimeBase = TimeBase()
    resample: Resampling | None = None
    split: Splitting = Splitting()
    csv: Delimited = Delimited()
    training: Training = Training()
    columns: Mapping[Name, Column] = Field(min_length=1)
    _file: str = pydantic.PrivateAttr("columns.toml")

    @pydantic.model_validator(mode="after")
    def _resampled_to_a_rate(self) -> "Columns":
        for name, column in self.columns.items():
            if column.resample is not None and self.resample is None:
                raise ValueError(
                    f"columns.{name}.resample needs a rate: give [resample] rate_hz, or delete it"
                )
        return self

    @property
    def file(self) -> str:
        """What it was read from, as error messages name it."""
        return self._file

    @property
    def used(self) -> dict[str, Column]:
        """The columns that have a role."""
        return {n: c for n, c in self.columns.items() if set(c.roles) - {"unused"}}

    def with_role(self, *roles: Role) -> dict[str, Column]:
        """The columns that have one of these roles."""
        return {n: c for n, c in self.columns.items() if set(c.roles) & set(roles)}


def read_columns(path: Path | str) -> Columns:
    """Read and check a `columns.toml`; UnusableInput names the file, the entry and the bound."""
    path = Path(path)
    try:
        text = text_of(path)
    except (OSError, ValueError) as error:
        raise UnusableInput(
            f"{path}: cannot be read ({one_line(error)}); write a first one with: wakedeploy data"
            " import table LOG --guess --columns columns.toml"
        ) from error
    return parse_columns(text, str(path))


def parse_columns(text: str, name: str = "columns.toml") -> Columns:
    """Check the text of a `columns.toml`; `name` stands in error messages."""
    try:
        raw = toml_of(text)
    except ValueError as error:
        raise UnusableInput(f"{name}: not valid TOML: {one_line(error)}.") from error
    version = raw.get("version")
    if version is None:
        raise UnusableInput(
            f"{name}: version is missing; write version = {VERSION} above its first section."
        )
    if isinstance(version, int) and version > VERSION:
        raise UnusableInput(
            f"{name}: version {version} is newer than this wakedeploy reads ({VERSION});"
            " upgrade it."
        )
    try:
        read = Columns.model_validate(raw)
    except pydantic.ValidationError as error:
        problem = _clause(first_problem(error)) + _known_beside(error)
        raise UnusableInput(f"{name}: {problem}.") from error
    read._file = name
    if not read.used:
        roles = "input, output, observation or force"
        raise UnusableInput(f"{name}: no column has a role yet; give some the role {roles}.")
    return read


def _known_beside(error: pydantic.ValidationError) -> str:
    """The entries that a table may have, for one that is not known; the nearest first."""
    problem = error.errors()[0]
    if problem["type"] != "extra_forbidden":
        return ""
    *tables, entry = map(str, problem["loc"])
    known = list(_table_at(tables).model_fields)
    near = difflib.get_close_matches(entry.lower(), known, 1, 0.6)
    meant = f" ({near[0]}?)" if near else ""
    return f"{meant}; known are {', '.join(known)}"


def _table_at(path: Sequence[str]) -> type[_Table]:
    """The kind of a table that has only tables above it."""
    if not path:
        return Columns
    if path[0] == "columns":
        return Column
    kind = Columns.model_fields[path[0]].annotation
    found = next(k for k in (kind, *get_args(kind)) if isinstance(k, type) and k is not type(None))
    return found if issubclass(found, _Table) else Columns


def _clause(problem: str) -> str:
    """A problem without pydantic's words for keys, and for the two ways to write a role."""
    problem = re.sub(r"\.\[key\](?=[ :])", "", problem)
    return re.sub(r"\.(literal|tuple)\[[^=]*?\](?=[ :.])", "", problem).rstrip(".")
