"""The columns of a run log, and the table that a file of one holds."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

Value = float | int | str | None
SCHEMA = 2  # of an MCAP file: 1 had one message with all columns a tick
MODES = ("DISARMED", "ARMED", "RUNNING", "DEGRADED", "LANDING", "FAILSAFE")
FLYING = ("RUNNING", "DEGRADED")


@dataclass(frozen=True)
class Column:
    """One column: its name, unit and kind, and who has to have it.

    `presence`: a file without a "required" column is refused; a "usual" one is filled with missing
    values; an "extra" one is in memory and in files only where it was recorded.
    """

    name: str
    unit: str
    kind: Literal["number", "integer", "text"] = "number"
    presence: Literal["required", "usual", "extra"] = "usual"


COLUMNS = (
    Column("tick", "", "integer", "required"),
    Column("t_s", "s", "number", "required"),
    Column("range_m", "m", "number", "required"),
    Column("range_age_s", "s", "number", "required"),
    Column("range_repeats", "", "integer"),
    Column("steps", "", "integer", "required"),
    Column("x_m", "m"),
    Column("vx_mps", "m/s"),
    Column("z_est_m", "m"),
    Column("vz_est_mps", "m/s"),
    Column("innovation_m", "m"),
    Column("innovation_var_m2", "m^2"),
    Column("z_ref_m", "m"),
    Column("x_ref_m", "m"),
    Column("force_pred_n", "N"),
    Column("feedforward_n", "N"),
    Column("pid_p_n", "N"),
    Column("pid_i_n", "N"),
    Column("pid_d_n", "N"),
    Column("source_cmd_us", "us", "number", "required"),
    Column("sufferer_cmd_us", "us", "number", "required"),
    Column("source_applied_us", "us"),
    Column("sufferer_applied_us", "us"),
    Column("seq_echo", "", "integer"),
    Column("round_trip_s", "s"),
    Column("t_read_s", "s"),
    Column("t_estimate_s", "s"),
    Column("t_predict_s", "s"),
    Column("t_control_s", "s"),
    Column("t_write_s", "s"),
    Column("mode", "", "text", "required"),
    Column("faults", "", "text"),
    Column("applied_time_s", "s"),
    Column("homed", "", "integer"),
    Column("battery_v", "V", "number", "extra"),
    Column("gap_score", "", "number", "extra"),
    Column("true_wake_force_n", "N", "number", "extra"),
    Column("true_hook_force_n", "N", "number", "extra"),
    Column("true_z_m", "m", "number", "extra"),
)
COLUMN = {column.name: column for column in COLUMNS}
EXTRA = frozenset(column.name for column in COLUMNS if column.presence == "extra")
# What a tick's messages hold, by topic. The last one closes the tick: without it, none is read.
TOPICS = {
    "/height": (
        "range_m",
        "range_age_s",
        "range_repeats",
        "z_est_m",
        "vz_est_mps",
        "z_ref_m",
        "innovation_m",
        "innovation_var_m2",
    ),
    "/carriage": ("steps", "x_m", "vx_mps", "x_ref_m", "homed"),
    "/force": (
        "force_pred_n",
        "feedforward_n",
        "pid_p_n",
        "pid_i_n",
        "pid_d_n",
        "gap_score",
    ),
    "/motors": (
        "source_cmd_us",
        "sufferer_cmd_us",
        "source_applied_us",
        "sufferer_applied_us",
        "applied_time_s",
        "battery_v",
    ),
    "/timing": (
        "seq_echo",
        "round_trip_s",
        "t_read_s",
        "t_estimate_s",
        "t_predict_s",
        "t_control_s",
        "t_write_s",
    ),
    "/truth": ("true_wake_force_n", "true_hook_force_n", "true_z_m"),
    "/state": ("tick", "t_s", "mode", "faults"),
}
STAGES = ("t_read_s", "t_estimate_s", "t_predict_s", "t_control_s", "t_write_s")


def is_missing(value: object) -> bool:
    """None, NaN or an empty text."""
    return value is None or value == "" or value != value


def plain_value(column: Column, value: Any) -> Value:
    """A value as files hold it: None for missing, int, float or str by the column's kind."""
    if column.kind == "text":
        return "" if value is None else str(value)
    if value is None or value != value:
        return None
    return int(value) if column.kind == "integer" else float(value)


def refuse_unknown(names: Iterable[str]) -> None:
    """ValueError if a name is no column of a run log."""
    unknown = sorted(set(names) - COLUMN.keys())
    if unknown:
        raise ValueError(f"no column(s) of a run log: {', '.join(unknown)}")


class Table(NamedTuple):
    """What a file of a run says, unchecked: column names, a mapping per tick, metadata."""

    names: Sequence[str]
    rows: Sequence[Mapping[str, Value]]
    metadata: dict[str, str]
