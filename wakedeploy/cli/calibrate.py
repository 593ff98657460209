"""`wakedeploy calibrate`: a rig's constants measured at the rig, with spread and date."""

import click

from wakedeploy.cli.calibrate_options import Request, shared_options
from wakedeploy.cli.flight_options import curve_option, require_curve
from wakedeploy.cli.groups import Group
from wakedeploy.cli.numbers import Within
from wakedeploy.cli.output import answered_by_hand


@click.group(cls=Group)
def command() -> None:
    """Measure a rig's constants and write them, with spread and date, into the rig file.

    In this order, as each needs those before it: zero, range, latency, steps, noise, thrust, spool.
    A result that cannot be right is refused in one sentence, and the file stays as it is. A
    rehearsal with --virtual measures a simulation, so its results need a file of their own: --out.
    `wakedeploy doctor --rig FILE` tells which are missing or old.

    \b
    Example:
        wakedeploy calibrate zero --rig rig.toml --port /dev/ttyACM0
        wakedeploy calibrate zero --rig rig.toml --virtual --out desk.toml
    """


@command.command()
@shared_options
def zero(request: Request) -> None:
    """What the range sensor reads on the stop (range_sensor.bias_m): 20 s at rest, motors off.

    \b
    Example:
        wakedeploy calibrate zero --rig rig.toml --port /dev/ttyACM0
    """
    from runtime.calibration import zero as procedure

    rig = request.rig("range_sensor.bias_m")
    question = "Let the sufferer rest on the stop and the carriage at its home."
    (log,) = request.measured(rig, procedure.record, [(question,)])
    request.finish(rig, procedure.estimate(log, rig))


@command.command(name="range")
@click.option("--height-m", "heights_m", type=Within(), multiple=True, required=True,
              help="A known height above the stop; two or more, 0 is the stop.")  # fmt: skip
@shared_options
def range_(request: Request, heights_m: tuple[float, ...]) -> None:
    """Bias and scale of the range sensor, the sufferer resting on spacers of known height.

    10 s for each height, motors off. With --log: one log for each height, in the same order.

    \b
    Example:
        wakedeploy calibrate range --height-m 0 --height-m 0.4 --height-m 0.8 \\
            --rig rig.toml --port /dev/ttyACM0
    """
    from runtime.calibration import heights as procedure

    rig = request.rig("range_sensor.bias_m", "range_sensor.scale")
    procedure.require_heights(heights_m, rig)
    runs = [
        (f"Let the sufferer rest {height_m:g} m above the stop.", height_m, number)
        for number, height_m in enumerate(heights_m, 1)
    ]
    logs = request.measured(rig, procedure.record, runs)
    request.finish(rig, procedure.estimate(logs, heights_m, rig))


@command.command()
@curve_option
@shared_options
def noise(request: Request, trust_curve: bool) -> None:
    """The scatter of single range readings (range_sensor.noise_m): a hover of 25 s, source off.

    With --log: any log with a hover of constant height and the source off.

    \b
    Example:
        wakedeploy calibrate noise --rig rig.toml --port /dev/ttyACM0
    """
    from runtime.calibration import noise as procedure

    rig = request.rig("range_sensor.noise_m")
    require_curve(rig, request.rig_path, port=request.port, trusted=trust_curve)
    question = "The sufferer will hover: keep clear, with the emergency stop at hand."
    (log,) = request.measured(rig, procedure.record, [(question,)])
    request.finish(rig, procedure.estimate(log, rig))


@command.command()
@shared_options
def latency(request: Request) -> None:
    """From measurement to actuation (latency.round_trip_s): 20 s at rest, motors off.

    The age of a range sample when it can first be read, plus the round trip of a command. With
    --log: any log of the rig.

    \b
    Example:
        wakedeploy calibrate latency --rig rig.toml --port /dev/ttyACM0
    """
    from runtime.calibration import latency as procedure

    rig = request.rig("latency.round_trip_s")
    (log,) = request.measured(rig, procedure.record, [("",)])
    request.finish(rig, procedure.estimate(log, rig))


@command.command()
@click.option("--mass-kg", "clips_kg", type=Within(), multiple=True, required=True,
              help="A known mass clipped onto the sufferer; 0 is none.")  # fmt: skip
@curve_option
@shared_options
def thrust(request: Request, clips_kg: tuple[float, ...], trust_curve: bool) -> None:
    """The sufferer's thrust curve (thrust.sufferer.thrust_n), from hovering with known masses.

    A flight of half a minute for each mass, the source off; sufferer.mass_kg has to be right.
    Three different masses or more, the heaviest sufferer at least 10 % above the lightest. Without
    a measured battery voltage (battery.has_divider) the first mass again at the end. The
    source cannot hover: its thrust is only known as wake strength times thrust. With --log: one log
    for each mass, in the same order.

    \b
    Example:
        wakedeploy calibrate thrust --mass-kg 0 --mass-kg 0.1 --mass-kg 0.2 --mass-kg 0 \\
            --rig rig.toml --port /dev/ttyACM0
    """
    from runtime.calibration import thrust as procedure

    rig = request.rig("thrust.sufferer.thrust_n")
    require_curve(rig, request.rig_path, port=request.port, trusted=trust_curve)
    procedure.require_masses(clips_kg, rig)
    question = "Clip {:g} kg onto the sufferer, charge the battery, and keep clear: it will fly."
    runs = [(question.format(kg), kg, number) for number, kg in enumerate(clips_kg, 1)]
    logs = request.measured(rig, procedure.record, runs)
    request.finish(rig, procedure.estimate(logs, clips_kg, rig))


@command.command()
@click.option(
    "--distance-m", type=Within(), help="Where to drive, from home; negative: to the left."
)
@click.option("--measured-m", type=Within(), help="The distance measured; else it is asked for.")
@click.option("--hold-s", type=Within(3, 600),
              help="How long to stand there and be measured (default: 40).")  # fmt: skip
@shared_options
def steps(
    request: Request, distance_m: float | None, measured_m: float | None, hold_s: float | None
) -> None:
    """The carriage's steps per metre (stepper.steps_per_m): drive, measure with a rule, drive home.

    Motors stay off. With --log: the log of such a drive, and --measured-m.

    \b
    Example:
        wakedeploy calibrate steps --distance-m 0.5 --rig rig.toml --port /dev/ttyACM0
    """
    from runtime.calibration import steps_per_metre as procedure
    from wakedeploy.core.errors import UnusableInput

    rig = request.rig("stepper.steps_per_m")
    if (distance_m is None) != bool(request.logs):
        raise UnusableInput("Give --distance-m for a drive, or --log with --measured-m.")
    if request.logs and hold_s is not None:
        raise UnusableInput("--hold-s belongs to a drive; a --log has its own time.")
    if request.logs and measured_m is None:
        raise UnusableInput("A log does not tell how far the carriage went: give --measured-m.")
    if distance_m is not None:
        procedure.require_distance(distance_m, rig)
    stand_s = 40.0 if hold_s is None else hold_s
    question = (
        f"Mark where the carriage stands. It will drive {distance_m} m, stand for {stand_s:g} s, "
        "in which you measure how far it went, and drive home."
    )
    (log,) = request.measured(rig, procedure.record, [(question, distance_m, stand_s)])
    if measured_m is None and request.virtual:
        # What a rule would show, to the millimetre.
        true_m = procedure.steps_out(log) / request.true_rig(rig).stepper.steps_per_m
        measured_m = round(true_m, 3)
    elif measured_m is None:
        with answered_by_hand("give the distance by --measured-m"):
            measured_m = float(click.prompt("Measured distance [m]", type=Within(), err=True))
    request.finish(rig, procedure.estimate(log, measured_m, rig))


@command.command()
@curve_option
@shared_options
def spool(request: Request, trust_curve: bool) -> None:
    """How the sufferer's rotor lags (spool.sufferer.up_s, down_s): thrust steps, up and down.

    A flight of half a minute in which the reference's acceleration changes sign twice a second.
    Calibrate noise, latency and thrust before. With --log: the log of such a flight.

    \b
    Example:
        wakedeploy calibrate spool --rig rig.toml --port /dev/ttyACM0
    """
    from runtime.calibration import spool as procedure

    rig = request.rig("spool.sufferer.up_s")
    require_curve(rig, request.rig_path, port=request.port, trusted=trust_curve)
    question = "The sufferer will fly quickly up and down: keep clear."
    (log,) = request.measured(rig, procedure.record, [(question,)])
    request.finish(rig, procedure.estimate(log, rig))
