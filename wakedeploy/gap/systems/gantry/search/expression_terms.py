"""The terms of an unknown force: some eighty functions c·f(state of the rig).

In: a term's name. Out: an effect with one parameter, or with two for a wave of free phase. If a
term depends on a quantity that hardly leaves a mean, its function is centred there: otherwise it
would pass for the thrust scale that every fit has. Its prior allows 0.2 N at a typical value.
"""

import functools
import math
import re
from collections.abc import Iterator, Mapping

from wakedeploy.physics.effects.base import Parameter
from wakedeploy.physics.effects.symbolic import ExpressionForce, expression_force

_PRIOR_N = 0.2
_BOUND = 15.0  # in prior scales: 3 N
_Z = "(z_m - 0.4*travel_m)"
_SOURCE = "(source_n - 0.6*weight_n)"
_THRUST = "(sufferer_n - weight_n)"

# name: (what it depends on; function; unit of c; how large the function typically is)
_SINGLE: Mapping[str, tuple[str, str, str, float]] = {
    "constant": ("nothing: it is always there", "1", "N", 1.0),
    "drift": ("time", "(time_s - 7)", "N/s", 4.0),
    "drift-squared": ("time, squared", "((time_s - 7)**2 - 16)", "N/s^2", 15.0),
    "way": ("the carriage's way so far", "(travelled_m - 1)", "N/m", 1.0),
    "height": ("height", _Z, "N/m", 0.2),
    "height-squared": ("height, squared", f"({_Z}**2 - 0.04)", "N/m^2", 0.05),
    "height-cubed": ("height, cubed", f"{_Z}**3", "N/m^3", 0.02),
    "height-low": ("how far the height is below 0.3 m", "max(0.3 - z_m, 0)", "N/m", 0.1),
    "height-near": ("height, fading over 0.1 m", "exp(-z_m/0.1)", "N", 0.3),
    "height-high": ("height in the upper half", "max(z_m - 0.5*travel_m, 0)", "N/m", 0.1),
    "speed": ("vertical speed", "vz_mps", "N s/m", 0.15),
    "speed-squared": (
        "vertical speed, squared, with its sign",
        "vz_mps*abs(vz_mps)",
        "N s^2/m^2",
        0.03,
    ),
    "speed-sign": ("the sign of the vertical speed", "tanh(vz_mps/0.02)", "N", 0.8),
    "rising": ("speed upwards, squared", "max(vz_mps, 0)**2", "N s^2/m^2", 0.03),
    "sinking": ("speed downwards, squared", "min(vz_mps, 0)**2", "N s^2/m^2", 0.03),
    "speed-height": ("vertical speed and height", f"vz_mps*{_Z}", "N s/m^2", 0.03),
    "place": ("the carriage's place", "x_m", "N/m", 0.3),
    "place-squared": ("the carriage's place, squared", "(x_m**2 - 0.06)", "N/m^2", 0.06),
    "place-size": ("the carriage's distance from the middle", "(abs(x_m) - 0.2)", "N/m", 0.15),
    "place-height": ("the carriage's place and height", f"x_m*{_Z}", "N/m^2", 0.06),
    "carriage": ("the carriage's speed", "vx_mps", "N s/m", 0.2),
    "carriage-size": ("the carriage's speed in size", "(abs(vx_mps) - 0.1)", "N s/m", 0.1),
    "carriage-squared": ("the carriage's speed, squared", "vx_mps**2", "N s^2/m^2", 0.05),
    "carriage-speed": ("both speeds", "vx_mps*vz_mps", "N s^2/m^2", 0.03),
    "carriage-place": ("the carriage's place and speed", "x_m*vx_mps", "N s/m^2", 0.05),
    "direction": ("which way the carriage moved last", "direction", "N", 1.0),
    "source": ("the source's thrust", _SOURCE, "1", 1.5),
    "source-squared": (
        "the source's thrust, squared",
        f"({_SOURCE}**2 - 0.1*weight_n**2)",
        "1/N",
        2.0,
    ),
    "source-rate": ("how fast the source's thrust changes", "source_rate_nps", "s", 5.0),
    "source-rate-size": (
        "how fast the source's thrust changes, in size",
        "abs(source_rate_nps)",
        "s",
        4.0,
    ),
    "source-height": ("the source's thrust and height", f"{_SOURCE}*{_Z}", "1/m", 0.3),
    "source-place": ("the source's thrust and the carriage's place", "source_n*x_m", "1/m", 0.9),
    "source-carriage": (
        "the source's thrust and the carriage's speed",
        "source_n*vx_mps",
        "s/m",
        0.6,
    ),
    "own-thrust": ("the sufferer's thrust", _THRUST, "1", 0.4),
    "thrust-squared": ("the sufferer's thrust, squared", f"{_THRUST}**2", "1/N", 0.2),
    "thrust-height": ("the sufferer's thrust and height", f"{_THRUST}*{_Z}", "1/m", 0.08),
    "thrust-place": (
        "the sufferer's thrust and the carriage's place",
        f"{_THRUST}*x_m",
        "1/m",
        0.1,
    ),
    "thrust-speed": ("the sufferer's thrust and speed", f"{_THRUST}*vz_mps", "s/m", 0.06),
    "thrust-wake": ("the sufferer's thrust in the wake's air", "sufferer_n*wake_mps", "s/m", 10.0),
    "air": ("the air's vertical speed", "wake_mps", "N s/m", 3.0),
    "wake-force": ("the wake's force", "wake_n", "1", 0.5),
    "wake-squared": ("the wake's force, squared", "wake_n*abs(wake_n)", "1/N", 0.3),
    "wake-height": ("the wake's force and height", f"wake_n*{_Z}", "1/m", 0.1),
    "wake-speed": ("the wake's force and vertical speed", "wake_n*vz_mps", "s/m", 0.08),
    "wake-place": ("the wake's force and the carriage's place", "wake_n*x_m", "1/m", 0.1),
    "wake-carriage": ("the wake's force and the carriage's speed", "wake_n*vx_mps", "s/m", 0.1),
    "wake-carriage-size": (
        "the wake's force and the carriage's speed in size",
        "wake_n*abs(vx_mps)",
        "s/m",
        0.1,
    ),
    "wake-drift": ("the wake's force and time", "wake_n*(time_s - 7)", "1/s", 2.0),
}
_STRETCH = re.compile(r"stretch-(?P<second>\d{1,3})s")
_STRETCHES = tuple(f"stretch-{second}s" for second in range(2, 19, 2))
_WAVE = re.compile(r"wave-in-(time-(?P<mhz>\d{3,5})mhz|(?P<axis>height|place)-(?P<mm>\d{2,4})mm)")
_HEIGHT_MM = (50, 60, 72, 86, 104, 125, 150, 200, 300)
# 1.25 periods per metre apart: passes of 0.8 m can hardly tell waves that are closer together. The
# shortest is the way of a belt on a pulley of 20 teeth of 2 mm.
_PLACE_MM = tuple(round(1000 / (1.25 * n)) for n in range(2, 21))
_WAVES_IN_STATE = tuple(
    f"wave-in-{axis}-{mm}mm"
    for axis, lengths in (("height", _HEIGHT_MM), ("place", _PLACE_MM))
    for mm in lengths
)
_NEAR_PER_M = (-0.8, -0.4, 0.4, 0.8)


class Terms(Mapping[str, ExpressionForce]):
    """The terms by name; a wave may be asked for at any frequency or length, listed or not.

    `wave-in-time-1500mhz` has 1.5 Hz, `wave-in-height-100mm` and `wave-in-place-100mm` have lengths
    of 0.1 m; `stretch-8s` is a force that comes and goes around the 8th second of every flight.
    """

    def __getitem__(self, name: str) -> ExpressionForce:
        try:
            return _term(name)
        except ValueError as error:
            raise KeyError(name) from error

    def __contains__(self, name: object) -> bool:
        if not isinstance(name, str):
            return False
        patterns = (_WAVE, _STRETCH)
        return name in _SINGLE or any(pattern.fullmatch(name) for pattern in patterns)

    def __iter__(self) -> Iterator[str]:
        return iter((*_SINGLE, *_STRETCHES, *_WAVES_IN_STATE))

    def __len__(self) -> int:
        return len(_SINGLE) + len(_STRETCHES) + len(_WAVES_IN_STATE)


TERMS = Terms()


def wave_in_time(frequency_hz: float) -> str:
    """The name of the wave in time nearest to a frequency of 0.1 to 99 Hz."""
    return f"wave-in-time-{round(1000 * frequency_hz):03d}mhz"


def is_wave_in_time(name: str) -> bool:
    """Whether a term repeats itself in time, at whatever frequency."""
    return name.startswith("wave-in-time-")


def neighbours(name: str) -> tuple[str, ...]:
    """Waves a little longer and shorter than this one; () for any other term."""
    wave = _WAVE.fullmatch(name)
    if wave is None:
        return ()
    if wave["mhz"]:
        middle = int(wave["mhz"])
        return tuple(wave_in_time(1e-3 * (middle + off)) for off in (-20, -10, 10, 20))
    middle = int(wave["mm"])
    near = {round(1000 / (1000 / middle + off)) for off in _NEAR_PER_M}
    lengths = sorted(near - {middle})
    return tuple(f"wave-in-{wave['axis']}-{mm:02d}mm" for mm in lengths)


@functools.cache
def _term(name: str) -> ExpressionForce:
    if name in _SINGLE:
        depends_on, function, unit, typical = _SINGLE[name]
        expression = "c" if function == "1" else f"c*{function}"
        parameters = [_parameter("c", unit, _PRIOR_N / typical)]
        return expression_force(
            name, f"A force that depends on {depends_on}.", expression, parameters
        )
    stretch = _STRETCH.fullmatch(name)
    if stretch is not None:
        return expression_force(
            name,
            f"A force that comes and goes around second {stretch['second']} of a flight.",
            f"c*exp(-((time_s - {stretch['second']})/1.2)**2)",
            [_parameter("c", "N", _PRIOR_N)],
        )
    wave = _WAVE.fullmatch(name)
    if wave is None:
        raise ValueError(f"{name!r} is no term")
    if wave["mhz"]:
        variable, per_unit, words = "time_s", int(wave["mhz"]) / 1000, "time"
    else:
        variable = {"height": "z_m", "place": "x_m"}[wave["axis"]]
        per_unit, words = 1000 / int(wave["mm"]), wave["axis"]
    phase = f"{math.tau * per_unit:.6g}*{variable}"
    return expression_force(
        name,
        f"A force that goes up and down with {words}.",
        f"a*sin({phase}) + b*cos({phase})",
        [_parameter(part, "N", _PRIOR_N) for part in ("a", "b")],
    )


def _parameter(name: str, unit: str, scale: float) -> Parameter:
    return Parameter(name, unit, scale, low=-_BOUND * scale, high=_BOUND * scale, starts=(0.0,))
