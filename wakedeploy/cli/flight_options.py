"""What every command that flies asks for, and what it shows meanwhile."""

import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.numbers import Within
from wakedeploy.core.errors import UnusableInput

if TYPE_CHECKING:
    from runtime.request import RunRequest, Show
    from wakedeploy.core.rig import Rig
    from wakedeploy.core.rig_sections import ThrustCurve

FILE = click.Path(dir_okay=False, path_type=Path)
_BAR_WIDTH = 30
_DEFAULT_S = 20.0
_NEXT_TO = 0.02  # share by which a calibration on the virtual gantry may move a thrust
Command = Callable[..., Any]

_PLACE = (
    click.option("--virtual", is_flag=True, help="Fly the virtual gantry, in simulated time."),
    click.option(
        "--wall-clock", is_flag=True, help="With --virtual: in real time, over a pseudo-terminal."
    ),
    click.option("--firmware", is_flag=True, help="With --virtual: the sketch on a simulated UNO."),
    click.option("--port", help="Serial port of the UNO, such as /dev/ttyACM0."),
    click.option(
        "--range-socket", type=FILE, help="With --port: range samples from here, not I²C."
    ),
    click.option("--plant-rig", type=FILE, help="What the virtual gantry is in truth."),
    click.option(
        "--realtime/--no-realtime",
        default=None,
        help="SCHED_FIFO, locked memory, one core. Default: where the computer permits it.",
    ),
)
_CURVE = click.option(
    "--trust-curve", is_flag=True, help="With --port: fly even on the default rig's thrust curve."
)
_FLIGHT = (
    click.option(
        "--package",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="Predictor whose force is fed forward; a folder of C is one, too.",
    ),
    click.option(
        "--backend",
        type=click.Choice(("onnx", "c")),
        help="How a package's file is computed. Default: onnx; c makes C of it, once.",
    ),
    click.option("--baseline", is_flag=True, help="PID alone, no package."),
    click.option("--rig", type=FILE, help="Default: the default rig."),
    *_PLACE,
    click.option(
        "--seconds",
        type=Within(6, 3600),
        show_default="20",
        help="Of the random plan.",
    ),
    click.option(
        "--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Of the plan."
    ),
    click.option("--reference", type=FILE, help="Fly this CSV instead of a random plan."),
    click.option("--hooks", help="MODULE:FUNCTION giving the virtual plant's hooks."),
    click.option(
        "--allow-lead-mismatch", is_flag=True, help="Fly a package made for another lead."
    ),
    _CURVE,
)


def flight_options(function: Command) -> Command:
    """Give a command the options of a flight; `flight_request` takes their values."""
    return with_options(_FLIGHT, function)


def place_options(function: Command) -> Command:
    """Give a command the options that say where to fly; `require_place` judges them."""
    return with_options(_PLACE, function)


def curve_option(function: Command) -> Command:
    """Give a command the option that `require_curve` takes as `trusted`."""
    return _CURVE(function)


def with_options(options: Sequence[Callable[[Command], Command]], function: Command) -> Command:
    """Give a command options, which its help lists in this order."""
    for option in reversed(options):
        function = option(function)
    return function


def require_place(
    *,
    port: str | None,
    virtual: bool,
    firmware: bool,
    wall_clock: bool,
    realtime: bool | None,
    plant_rig: Path | None,
    range_socket: Path | None,
    hooks: str | None = None,
) -> None:
    """UnusableInput when options belong to the other place, or to none."""
    if not virtual and wall_clock:
        raise UnusableInput("--wall-clock belongs to --virtual; at a port time is always real.")
    if virtual and not wall_clock and realtime is not None:
        given = "--realtime" if realtime else "--no-realtime"
        raise UnusableInput(
            f"{given} belongs to --port or --wall-clock; --virtual alone flies in simulated time."
        )
    if port is None and range_socket:
        raise UnusableInput("--range-socket belongs to --port; --virtual has one of its own.")
    if not virtual and firmware:
        raise UnusableInput("--firmware belongs to --virtual; the UNO at a port has its own.")
    if not virtual and (plant_rig or hooks):
        given = "--plant-rig and --hooks belong" if hooks else "--plant-rig belongs"
        raise UnusableInput(f"{given} to --virtual; a real rig is as it is.")


def require_curve(rig: "Rig", path: Path | None, *, port: str | None, trusted: bool) -> None:
    """UnusableInput before a real flight on the default gantry's estimated thrust curve.

    A motor that gives more than the curve says takes off too fast. What a rehearsal on the virtual
    gantry calibrates is that curve again, with the noise of the rehearsal.
    """
    from wakedeploy.rig.file import default_rig

    curve, estimate = rig.thrust.sufferer, default_rig().thrust.sufferer
    if port and not trusted and _is_nearly(curve, estimate):
        raise UnusableInput(
            f"{path or 'The default rig'}: [thrust.sufferer] is the default gantry's estimate, or "
            "next to it as after a rehearsal, and a stronger motor throws the sufferer against the "
            "top; enter the curve of a bench or a data sheet, which wakedeploy calibrate thrust "
            "then corrects, or say --trust-curve if it is right."
        )


def _is_nearly(curve: "ThrustCurve", estimate: "ThrustCurve") -> bool:
    """Whether a thrust curve is another, or that times a factor next to 1."""
    if curve.pulse_us != estimate.pulse_us:
        return False
    pairs = zip(curve.thrust_n, estimate.thrust_n, strict=True)
    return all(math.isclose(mine, its, rel_tol=_NEXT_TO) for mine, its in pairs)


def asked_flight(
    *,
    baseline: bool,
    virtual: bool,
    package: Path | None,
    port: str | None,
    rig: Path | None,
    plant_rig: Path | None,
    seconds: float | None,
    trust_curve: bool,
    **others: Any,
) -> dict[str, Any]:
    """What to fly, as `wakedeploy.fly` takes it; UnusableInput when options do not go together."""
    if (package is None) != baseline:
        raise UnusableInput("Say what to fly: either --package FILE or --baseline.")
    if baseline and others["allow_lead_mismatch"]:
        raise UnusableInput("--allow-lead-mismatch belongs to --package; PID alone has no lead.")
    if baseline and others["backend"] is not None:
        raise UnusableInput("--backend belongs to --package; PID alone has nothing to predict.")
    if (port is None) != virtual:
        raise UnusableInput("Say where to fly: either --virtual or --port PORT.")
    placing = {
        name: others[name]
        for name in ("firmware", "range_socket", "hooks", "wall_clock", "realtime")
    }
    require_place(port=port, virtual=virtual, plant_rig=plant_rig, **placing)
    if virtual and others.get("arm_file") and not others["wall_clock"]:
        raise UnusableInput("--arm-file waits for a person, in real time: add --wall-clock.")
    if seconds is not None and others["reference"]:
        raise UnusableInput("--seconds belongs to the random plan; a --reference has its own time.")
    from wakedeploy.api.inputs import rig_of

    require_curve(rig_of(rig), rig, port=port, trusted=trust_curve)
    asked = {"package": package, "port": port, "rig": rig, "plant_rig": plant_rig}
    return asked | {"seconds": _DEFAULT_S if seconds is None else seconds} | others


def flight_request(**options: Any) -> "RunRequest":
    """The same as the loop takes it."""
    from wakedeploy.api.flights import request_of

    return request_of(**asked_flight(**options))


def shown_progress() -> "Show | None":
    """The progress bar of a flight, where there is someone to see it."""
    return _show if sys.stderr.isatty() else None


def warn(sentence: str) -> None:
    """A line on stderr in the middle of a flight."""
    end_progress()
    sys.stderr.write(f"{sentence}\n")
    sys.stderr.flush()


def end_progress() -> None:
    """Take the bar away; it is drawn again if the flight goes on."""
    if sys.stderr.isatty():
        sys.stderr.write("\r\x1b[K")
        sys.stderr.flush()


def _show(done_s: float, total_s: float) -> None:
    """One line of a terminal, redrawn in place; a table's library would cost the loop more."""
    filled = round(_BAR_WIDTH * min(1.0, done_s / total_s))
    bar = "=" * filled + " " * (_BAR_WIDTH - filled)
    sys.stderr.write(f"\rFlying [{bar}] {done_s:.0f} of {total_s:.0f} s")
    sys.stderr.flush()
