"""Kinds of files that a gantry's owner hands over: rig files, run logs, references, expressions."""

import functools
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import numpy as np

from benchmarks.fuzz.binary import mcap_file
from benchmarks.fuzz.documents import json_file, toml_file
from benchmarks.fuzz.kind import Files, Kind, spoken, taken
from benchmarks.fuzz.tables import csv_file
from runtime.calibration import Outcome, latency, noise, spool, steps_per_metre, thrust, zero
from runtime.calibration.session import with_clip
from runtime.reference import require_plan_fits
from runtime.reference_file import read_reference, write_reference
from wakedeploy.cli import log as log_command
from wakedeploy.cli import rig as rig_command
from wakedeploy.core.expression import VARIABLES, expression_of
from wakedeploy.core.rig import Effect, EffectParameter, Rig
from wakedeploy.core.run_figure import draw_run
from wakedeploy.core.run_summary import summarise
from wakedeploy.core.runlog import RunLog, read_run_log
from wakedeploy.domains.gantry import record
from wakedeploy.domains.gantry_measured import measured_set
from wakedeploy.gap.systems.gantry.flight import read_flights
from wakedeploy.gap.systems.gantry.planning.manoeuvres import menu
from wakedeploy.physics.effects.chain import Chain, believed, default_lead_s
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig.file import default_rig, default_rig_text, read_rig
from wakedeploy.rig.update import Calibrated, update_rig

LOG_WAYS = {"*.csv": csv_file, "*.mcap": mcap_file, "*.json": json_file}
_FLIGHT_S = 9.0
_TICKS = 12  # of a log that is only read
_MEASURED = {
    "range_sensor.bias_m": Calibrated(0.012, 0.0003, "m"),
    "thrust.sufferer.thrust_n": Calibrated(tuple(0.75 * i for i in range(12)), 0.02, "N"),
}


def kinds() -> dict[str, Callable[[], Kind]]:
    """What makes each kind, by its name."""
    return {
        "rig": _rig,
        "rig-update": _rig_update,
        "rig-show": _rig_show,
        "log-csv": _log_csv,
        "log-mcap": _log_mcap,
        "log-show": _log_show,
        "log-picture": _log_picture,
        "flight": _flight,
        "smoothing": _smoothing,
        "calibration": _calibration,
        "reference": _reference,
        "expression": _expression,
    }


def bare(text: str) -> bytes:
    """A rig file without its comments, which would take most of the damage."""
    lines = (line.split("#")[0].rstrip() for line in text.splitlines())
    return "\n".join(line for line in lines if line).encode() + b"\n"


@functools.cache
def rig_files() -> tuple[Files, ...]:
    """A plain rig file, one with spreads and units, and one with effects."""
    rig = default_rig()
    known = {"value": 452, "spread": 1.5, "unit": "g", "date": "2026-01-02"}
    spread = rig.changed(wake={"speed_mps": {"value": 5.5, "spread": 0.5, "unit": "m/s"}})
    effects = (
        Effect(
            name="symbolic-force",
            expression="c1*sin(9.4*time_s) + c2*x_m",
            parameters={n: EffectParameter(value=0.1, unit="N") for n in ("c1", "c2")},
        ),
        Effect(
            name="ground-effect",
            parameters={
                "gain": EffectParameter(value=0.2, unit="1", low=0.1, high=0.3),
                "height_m": EffectParameter(value=0.15, unit="m"),
            },
            date="2026-01-02",
        ),
    )
    in_grams = bare(spread.text).replace(b"mass_kg = 0.45", f"mass_kg = {_inline(known)}".encode())
    changed = rig.model_copy(update={"effect": effects})
    texts = (bare(default_rig_text()), in_grams, bare(changed.text))
    return tuple({"rig.toml": text} for text in texts)


def _inline(table: dict[str, Any]) -> str:
    pairs = ", ".join(
        f'{k} = "{v}"' if isinstance(v, str) else f"{k} = {v}" for k, v in table.items()
    )
    return f"{{ {pairs} }}"


def _rig() -> Kind:
    return Kind("rig", "rig files", rig_files(), _read_rig, {"*.toml": toml_file})


def _read_rig(folder: Path) -> None:
    """As `rig show` does, and as a flight begins."""
    rig = read_rig(folder / "rig.toml")
    _ = Chain.of(rig).values, rig.sha256, default_lead_s(rig), believed(rig).text
    GantryPlant(rig, seed=0)


def _rig_show() -> Kind:
    return Kind("rig-show", "rig files, shown", rig_files(), _show_rig, {"*.toml": toml_file})


def _show_rig(folder: Path) -> None:
    with spoken():
        _called(rig_command.show, folder / "rig.toml", None)


def _called(command: click.Command, *arguments: Any) -> None:
    """A command as the command line calls it, its arguments as they stand in its signature."""
    assert command.callback is not None
    command.callback(*arguments)


def _rig_update() -> Kind:
    ways = {"*.toml": toml_file}
    return Kind("rig-update", "rig files, calibrated", rig_files(), _update_rig, ways, writes=True)


def _update_rig(folder: Path) -> None:
    """As `calibrate` ends."""
    path = folder / "rig.toml"
    update_rig(path, _MEASURED, "2026-01-02")
    read_rig(path)


@functools.cache
def flown() -> RunLog:
    """A simulated flight with a battery."""
    rig = default_rig().changed(battery={"has_divider": True})
    return record(rig, seconds=_FLIGHT_S, seed=3)


def written(log: RunLog, suffix: str) -> Files:
    """A log as a file, with its metadata where they lie beside it."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / f"flight{suffix}"
        (log.write_csv if suffix == ".csv" else log.write_mcap)(path)
        return taken(Path(place))


@functools.cache
def _short() -> RunLog:
    log = flown()
    kept = np.unique(np.linspace(0, len(log) - 1, _TICKS).astype(int))
    some = log.select(kept)
    some.metadata = {k: v for k, v in log.metadata.items() if k != "rig_toml"}
    return some


def _log_csv() -> Kind:
    sound = (written(_short(), ".csv"), written(_short().without_truth(), ".csv"))
    read = functools.partial(_read_log, suffix=".csv")
    return Kind("log-csv", "run logs, CSV", sound, read, LOG_WAYS)


def _log_mcap() -> Kind:
    whole, cut = written(_short(), ".mcap"), written(_short().without_truth(), ".mcap")
    read = functools.partial(_read_log, suffix=".mcap")
    return Kind("log-mcap", "run logs, MCAP", (whole, cut), read, LOG_WAYS)


def _read_log(folder: Path, suffix: str) -> None:
    """As `log show --json` and `log export` do."""
    log = read_run_log(folder / f"flight{suffix}")
    summarise(log).as_json()
    _ = log.has("battery_v"), log.tracking_rmse_m(), list(log.rows())


def _log_show() -> Kind:
    sound = (written(_short(), ".csv"), written(_short(), ".mcap"))
    return Kind("log-show", "run logs, shown", sound, _show_log, LOG_WAYS, writes=True)


def _show_log(folder: Path) -> None:
    path = _log_of(folder)
    with spoken():
        _called(log_command.show, (path,), None, True, folder / "told.json")
        _called(log_command.export, path, folder / "again.csv")


def _log_picture() -> Kind:
    sound = (written(_short(), ".csv"),)
    return Kind("log-picture", "run logs, drawn", sound, _draw_log, LOG_WAYS, slowest_s=10.0)


def _draw_log(folder: Path) -> None:
    """As `log show` does, the file of the picture aside."""
    from matplotlib import pyplot

    log = read_run_log(folder / "flight.csv")
    figure = draw_run(log, summarise(log), "flight.csv")
    figure.draw_without_rendering()
    pyplot.close("all")


@functools.cache
def _flights() -> tuple[Files, ...]:
    return (written(flown().without_truth(), ".csv"), written(flown().without_truth(), ".mcap"))


def _log_of(folder: Path) -> Path:
    return next(path for path in folder.iterdir() if path.suffix in (".csv", ".mcap"))


def _flight() -> Kind:
    return Kind("flight", "flights for the gap workflow", _flights(), _read_flight, LOG_WAYS)


def _read_flight(folder: Path) -> None:
    """As every gap command begins."""
    read_flights([_log_of(folder)], flown_rig())


def flown_rig() -> Rig:
    """The rig of the flights."""
    return default_rig().changed(battery={"has_divider": True})


def _smoothing() -> Kind:
    return Kind("smoothing", "flights to smooth", _flights(), _smooth, LOG_WAYS, names=("",))


def _smooth(folder: Path) -> None:
    """As `log smooth` does."""
    path = _log_of(folder)
    measured_set({path.stem: read_run_log(path)}, flown_rig())


def _calibration() -> Kind:
    made = _calibrations()
    sound = tuple(_named(name, log) for name, (log, _) in made.items())

    def calibrate(folder: Path) -> None:
        """As `calibrate --log` does."""
        path = _log_of(folder)
        made[path.stem][1](read_run_log(path))

    return Kind("calibration", "logs to calibrate from", sound, calibrate, LOG_WAYS, names=("",))


def _named(name: str, log: RunLog) -> Files:
    files = written(log.without_truth(), ".csv")
    return {file.replace("flight", name): content for file, content in files.items()}


def _calibrations() -> dict[str, tuple[RunLog, Callable[[RunLog], Outcome]]]:
    """For each constant a log, and what is made of it."""
    rig = flown_rig()
    rest = record(rig.changed(disturbance={"rest_s": 8.0}), seconds=4.0, seed=1)
    fly = functools.partial(record, seconds=0.0, seed=1)
    drive_rig, drive_plan = steps_per_metre.driving(rig, 0.4, 5.0)
    drive = fly(drive_rig, plan=drive_plan)
    moved_m = abs(steps_per_metre.steps_out(drive)) / rig.stepper.steps_per_m
    clips_kg = (0.0, 0.1, 0.2)
    swings = [fly(with_clip(rig, clip), plan=thrust.swinging(rig)) for clip in clips_kg]
    return {
        "zero": (rest, lambda log: zero.estimate(log, rig)),
        "latency": (rest, lambda log: latency.estimate(log, rig)),
        "noise": (fly(rig, plan=noise.hovering(rig)), lambda log: noise.estimate(log, rig)),
        "thrust": (swings[0], lambda log: thrust.estimate([log, *swings[1:]], clips_kg, rig)),
        "spool": (fly(rig, plan=spool.stepping(rig)), lambda log: spool.estimate(log, rig)),
        "steps": (drive, lambda log: steps_per_metre.estimate(log, moved_m, rig)),
    }


def _reference() -> Kind:
    rig = default_rig()
    sound = []
    with tempfile.TemporaryDirectory() as place:
        for manoeuvre in menu()[:2]:
            path = Path(place) / "plan.csv"
            write_reference(path, manoeuvre.plan(rig), rig, manoeuvre.name)
            lines = path.read_bytes().splitlines(keepends=True)
            sound.append({"plan.csv": b"".join([*lines[:3], *lines[3:-1:8], lines[-1]])})
        # A few rows by hand, as a person writes them.
        by_hand = b"t_s,z_m,x_m,source_us\n0,0,0,1000\n1,0,0,1000\n4,0.5,0.1,1500\n"
        sound.append({"plan.csv": by_hand + b"6,0.5,0.1,1500\n10,0,0,1000\n11,0,0,1000\n"})

    def fly(folder: Path) -> None:
        require_plan_fits(read_reference(folder / "plan.csv", rig), rig)

    return Kind(
        "reference", "references", tuple(sound), fly, {"*.csv": csv_file}, names=("The plan",)
    )


_EXPRESSIONS = (
    b"c1*sin(9.42*time_s) + c2*x_m",
    b"c1 * exp(-z_m / 0.2) - c2**2",
    b"max(c1, min(c2, abs(vz_mps)))",
    b"-c1*sqrt(abs(wake_n))/(1 + tanh(c2*source_n))",
    b"((c1)) + +-c2*sign(direction)**-2.5",
    b"c1*cos(2*3.14159*1e-3*travelled_m) + c2*charge_s*1e308",
)


def _expression() -> Kind:
    values = {name: np.linspace(-2.0, 2.0, 5) for name in VARIABLES} | {"c1": 0.5, "c2": -3.0}

    def evaluate(folder: Path) -> None:
        text = (folder / "expression").read_bytes().decode("utf-8", "surrogateescape")
        read = expression_of(text, ("c1", "c2"))
        np.asarray(read(values))
        assert expression_of(read.text, ("c1", "c2")) == read

    sound = tuple({"expression": text} for text in _EXPRESSIONS)
    names = ("The expression",)
    return Kind("expression", "symbolic expressions", sound, evaluate, names=names)
