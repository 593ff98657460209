"""`wakedeploy doctor`: what this machine can and cannot do, with the fix for each."""

import datetime
import glob
import os
import platform
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from wakedeploy.cli.output import json_option, print_table, progress, write_json
from wakedeploy.core.errors import UnusableInput, installs

if TYPE_CHECKING:
    from wakedeploy.core.rig import Calibration, Rig

OK, OPTIONAL, STALE, BROKEN = "ok", "optional", "stale", "BROKEN"
_ENOUGH_DISK_GIB = 1.0
_TRIAL_S = 60.0
_I2C_BUSES = "/dev/i2c-*"
_RUNTIME = "onnxruntime"
_FLIES_C = "packages fly here as C: `run-gantry --package gru.onnx --backend c`"
_LONGEST_FROZEN_S = 60.0  # flights are shorter
# Propellers, battery, belt and the sensor's window change within weeks of flying; nobody has
# measured how fast on this rig, so a month is a habit rather than a finding.
CALIBRATION_DAYS = 30
CALIBRATIONS = {
    "range_sensor.bias_m": "zero",
    "range_sensor.scale": "range",
    "range_sensor.noise_m": "noise",
    "latency.round_trip_s": "latency",
    "thrust.sufferer.thrust_n": "thrust",
    "stepper.steps_per_m": "steps",
    "spool.sufferer.up_s": "spool",
    "spool.sufferer.down_s": "spool",
}
# What these calibrations need besides, as an example.
_ASKED = {
    "range": " --height-m 0 --height-m 0.4 --height-m 0.8",
    "thrust": " --mass-kg 0 --mass-kg 0.1 --mass-kg 0.2 --mass-kg 0",
    "steps": " --distance-m 0.5",
}


@dataclass(frozen=True)
class Finding:
    """One thing looked at: ok, optional (only some uses need it), stale (renew it) or BROKEN."""

    name: str
    state: str
    found: str
    fix: str = ""


@click.command()
@click.option("--rig", "rig_path", type=click.Path(dir_okay=False, path_type=Path),
              help="Also tell which calibrations of this rig file are missing or old.")  # fmt: skip
@json_option
def command(rig_path: Path | None, json_path: Path | None) -> None:
    """Say what this machine can do: libraries, serial ports, real time, disk.

    Exit status 1 when something that every use needs is broken. With --rig, calibrations without a
    date or older than 30 days are stale; that alone is no failure.

    \b
    Example:
        wakedeploy doctor
        wakedeploy doctor --rig rig.toml
    """
    findings = calibrations(rig_path) if rig_path else []  # first, to refuse a file that is no rig
    findings = _looked() + findings
    rows = [[f.name, f.state, f.found] for f in findings]
    print_table("This machine", ["what", "state", "found"], rows)
    for finding in findings:
        if finding.fix:
            click.echo(f"{finding.name}: {finding.fix}")
    broken = any(finding.state == BROKEN for finding in findings)
    write_json(json_path, {"ok": not broken, "findings": [asdict(f) for f in findings]})
    raise click.exceptions.Exit(1 if broken else 0)


def _looked() -> list[Finding]:
    found: list[Finding] = []
    with progress("Looking at this machine", len(CHECKS)) as bar:
        for look in CHECKS:
            found += look()
            bar.advance()
    return found


def python_version() -> list[Finding]:
    """Python 3.11 to 3.13."""
    found = "{}.{}.{}".format(*sys.version_info[:3])
    if (3, 11) <= sys.version_info[:2] <= (3, 13):
        return [Finding("Python", OK, found)]
    return [Finding("Python", BROKEN, found, "make a virtual environment with Python 3.11–3.13.")]


def base_libraries() -> list[Finding]:
    """What every use needs, as the package's own metadata lists it."""
    return [_library(name) for name in _required("")]


def extras() -> list[Finding]:
    """The optional groups: complete, or what is missing and how to get it."""
    uses = {
        "train": "training, export and demo",
        "rig": "the range sensor on the Pi",
        "cluster": "tuning and sweeps on many machines",
        "tables": "Parquet",
        "tensorboard": "train --tracker tensorboard",
        "mlflow": "train --tracker mlflow",
    }
    return [finding for extra, use in uses.items() for finding in _extra(extra, use)]


def onnxruntime_starts() -> list[Finding]:
    """Import onnxruntime in a process of its own: a wrong build kills the interpreter."""
    if _version(_RUNTIME) is None:
        found, more = "missing", f"to check packages and fly them by it, too: {installs('onnx')}"
        if _lacks_wheels():
            found = f"no wheel for a 32-bit Python on {platform.machine()}"
            more = "to check packages take the 64-bit system"
        return [Finding("onnxruntime starts", OPTIONAL, found, f"{_FLIES_C}; {more}.")]
    ended = _try("import onnxruntime; print(onnxruntime.__version__)")
    if ended.returncode == 0:
        return [Finding("onnxruntime starts", OK, "yes")]
    fix = f"{installs('onnx')}; on a Raspberry Pi use the 64-bit system."
    return [Finding("onnxruntime starts", BROKEN, _why(ended), fix)]


def c_compiler() -> list[Finding]:
    """The compiler that predictors in C need, where they are written and where they fly."""
    from runtime.compiled.compiler import host_compiler, version_of

    try:
        return [Finding("C compiler", OK, version_of(host_compiler()))]
    except UnusableInput as error:
        return [Finding("C compiler", OPTIONAL, "none", f"for predictors in C: {error}")]


def serial_ports() -> list[Finding]:
    """USB serial ports, and whether this user may open them."""
    ports = sorted(glob.glob("/dev/ttyACM*") + glob.glob("/dev/ttyUSB*"))
    if not ports:
        fix = "connect the UNO by USB; `run-gantry --virtual` needs no port."
        return [Finding("serial port", OPTIONAL, "none", fix)]
    return [_device("serial port", port, "dialout") for port in ports]


def i2c_buses() -> list[Finding]:
    """The I²C buses that the range sensor may be on."""
    buses = sorted(glob.glob(_I2C_BUSES))
    if not buses:
        fix = "on a Raspberry Pi: sudo raspi-config nonint do_i2c 0; not needed with --virtual."
        return [Finding("I²C bus", OPTIONAL, "none", fix)]
    return [_device("I²C bus", bus, "i2c") for bus in buses]


def realtime() -> list[Finding]:
    """The loop's own `--realtime` settings, tried in a process of its own."""
    ended = _try("from runtime.io.realtime import become_realtime; become_realtime()")
    if ended.returncode == 0:
        return [Finding("--realtime", OK, "allowed")]
    return [Finding("--realtime", OPTIONAL, "not allowed", _why(ended))]


def free_disk() -> list[Finding]:
    """Room for logs and runs in the present folder."""
    free_gib = shutil.disk_usage(Path.cwd()).free / 2**30
    if free_gib >= _ENOUGH_DISK_GIB:
        return [Finding("free disk", OK, f"{free_gib:.1f} GiB")]
    fix = f"less than {_ENOUGH_DISK_GIB:g} GiB: delete old runs and logs, or work on another disk."
    return [Finding("free disk", OPTIONAL, f"{free_gib:.2f} GiB", fix)]


def calibrations(path: Path, today: datetime.date | None = None) -> list[Finding]:
    """Whether a rig file's calibrated constants have a date, and one of the last 30 days.

    Also how soon a sensor with its noise is found frozen, where that takes longer than usual.
    """
    from wakedeploy.rig.file import read_rig

    rig, now = read_rig(path), today or datetime.datetime.now(datetime.UTC).date()
    return [
        _calibration(name, procedure, rig.calibration.get(name), now, path)
        for name, procedure in CALIBRATIONS.items()
    ] + _frozen_sensor(rig)


def _frozen_sensor(rig: "Rig") -> list[Finding]:
    from runtime.loop.safety import RANGE_FROZEN_S
    from runtime.loop.silent_faults import frozen_limit_s

    limit_s, fix = frozen_limit_s(rig), "check range_sensor.noise_m and resolution_m."
    if limit_s <= RANGE_FROZEN_S:
        return []
    noticed = f"noticed after {limit_s:.1f} s" if limit_s < _LONGEST_FROZEN_S else "never noticed"
    return [Finding("frozen range sensor", OPTIONAL, f"{noticed}: its noise is below a step", fix)]


def _calibration(
    name: str, procedure: str, known: "Calibration | None", today: datetime.date, path: Path
) -> Finding:
    fix = f"wakedeploy calibrate {procedure} --rig {path} --port PORT{_ASKED.get(procedure, '')}"
    stated = known.date if known is not None else None
    if stated is None:
        return Finding(name, STALE, "never calibrated", fix)
    try:
        days = (today - datetime.date.fromisoformat(stated[:10])).days
    except ValueError:
        return Finding(name, STALE, f"date {stated!r} is none", fix)
    if days < -1:  # a day ahead may be a time zone
        return Finding(name, STALE, f"{stated} is still to come", f"check the clock, or {fix}")
    old = f"{stated}, {max(days, 0)} days old"
    return Finding(name, STALE, old, fix) if days > CALIBRATION_DAYS else Finding(name, OK, old)


CHECKS: Sequence[Callable[[], list[Finding]]] = (
    python_version,
    base_libraries,
    onnxruntime_starts,
    c_compiler,
    extras,
    serial_ports,
    i2c_buses,
    realtime,
    free_disk,
)


def _required(extra: str) -> list[str]:
    """The names of the libraries that the installed package requires, or one of its extras does."""
    from importlib.metadata import requires  # takes longer to load than the rest of --help

    wanted = []
    for requirement in requires("wakedeploy") or ():
        name = re.match(r"[A-Za-z0-9._-]+", requirement)
        group = re.search(r"extra == ['\"](\w+)['\"]", requirement)
        if name and (group[1] if group else "") == extra:
            wanted.append(name[0])
    return wanted


def _lacks_wheels() -> bool:
    """Whether no wheel of onnxruntime is made for this Python, as for a 32-bit Pi's."""
    return sys.maxsize < 2**32


def _version(library: str) -> str | None:
    from importlib import metadata

    try:
        return metadata.version(library)
    except metadata.PackageNotFoundError:
        return None


def _library(name: str) -> Finding:
    version = _version(name)
    if version is None:
        return Finding(name, BROKEN, "missing", installs(""))
    return Finding(name, OK, version)


def _sensor_driver() -> Finding | None:
    """Why the range sensor's driver cannot be loaded where there is a bus to use it on."""
    if not glob.glob(_I2C_BUSES):
        return None
    ended = _try("from runtime.io.range_source import import_driver; import_driver()")
    return Finding("[rig]", OPTIONAL, "not usable", _why(ended)) if ended.returncode else None


def _extra(extra: str, use: str) -> list[Finding]:
    versions = {name: _version(name) for name in _required(extra)}
    missing = [name for name, version in versions.items() if version is None]
    if missing:
        fix = f"for {use}: {installs(extra)}"
        return [Finding(f"[{extra}]", OPTIONAL, f"missing {', '.join(missing)}", fix)]
    unusable = _sensor_driver() if extra == "rig" else None
    if unusable is not None:
        return [unusable]
    return [Finding(f"[{extra}] {name}", OK, str(version)) for name, version in versions.items()]


def _device(name: str, path: str, group: str) -> Finding:
    if os.access(path, os.R_OK | os.W_OK):
        return Finding(name, OK, path)
    fix = f"sudo usermod -aG {group} $USER, then log in again."
    return Finding(name, OPTIONAL, f"{path}: no permission", fix)


def _try(code: str) -> subprocess.CompletedProcess[str]:
    """Run some Python in a process of its own, with this interpreter and its paths."""
    paths = f"import sys; sys.path[:] = {sys.path!r}\n"
    command_line = [sys.executable, "-c", paths + code]
    try:
        return subprocess.run(  # noqa: S603
            command_line, capture_output=True, text=True, timeout=_TRIAL_S, check=False
        )
    except subprocess.TimeoutExpired:
        return subprocess.CompletedProcess(command_line, 1, "", f"no answer in {_TRIAL_S:g} s")


def _why(ended: subprocess.CompletedProcess[str]) -> str:
    """Why a trial failed: the signal that ended it, or the last line it wrote, without its type."""
    if ended.returncode < 0:
        return f"ended by {signal.Signals(-ended.returncode).name}"
    last = (ended.stderr.strip().splitlines() or ["no reason given"])[-1]
    return re.sub(r"^[\w.]*(Error|UnusableInput|Exception): ", "", last)
