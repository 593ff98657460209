"""Forces and motors: pushes, friction, lost thrust, stronger wakes, another weight."""

from collections.abc import Callable
from functools import partial

from benchmarks.injected.fault import Fault, Scene
from wakedeploy.physics.rail import GRAVITY_MPS2
from wakedeploy.rig.file import default_rig

GROUP = "plant"
PUSHES_N = (0.5, -0.5, 1.0, -1.0, 2.0, -2.0, -3.0)
SAG_PER_S = 0.02

_RIG = default_rig()
_WEIGHT_N = _RIG.sufferer.mass_kg * GRAVITY_MPS2
RESERVE_N = (-(_RIG.thrust.sufferer.thrust_n[-1] - _WEIGHT_N), _WEIGHT_N - _RIG.rail.coulomb_n)
# What thrust can hold against without a wake: downwards full thrust less the weight, upwards the
# weight less friction, with the motor idle.


def pushed(scene: Scene, *, force_n: float) -> None:
    """Something pushes, upwards positive."""
    scene.world.plant.push_n = force_n


def rubs(scene: Scene, *, factor: float) -> None:
    """The rail's friction grows."""
    scene.world.plant.scale_friction(factor)


def thrusts(scene: Scene, *, factor: float) -> None:
    """The sufferer's motor gives less, or more."""
    scene.world.plant.sufferer_share = lambda t_s: factor


def sags(scene: Scene, *, per_s: float) -> None:
    """Both motors give less and less, down to half."""

    def thrust_share(t_s: float) -> float:
        return max(0.5, 1.0 - per_s * (t_s - scene.begins_s))

    scene.world.plant.source_share = scene.world.plant.sufferer_share = thrust_share


def wake_grows(scene: Scene, *, factor: float) -> None:
    """The wake's force grows."""
    scene.world.plant.wake_factor = factor


def weighs(scene: Scene, *, factor: float) -> None:
    """The sufferer's mass changes."""
    scene.world.plant.scale_mass(factor)


def lags(scene: Scene, *, factor: float) -> None:
    """The sufferer's motor follows more slowly."""
    scene.world.plant.scale_lag(factor)


def push(force_n: float, group: str = GROUP) -> Fault:
    """A push of so much, survivable where it is within the thrust reserve."""
    return Fault(
        f"push {force_n:+g} N",
        f"Something pushes the sufferer with {force_n:+g} N, upwards positive.",
        group,
        partial(pushed, force_n=force_n),
        survivable=RESERVE_N[0] < force_n < RESERVE_N[1],
    )


def _fault(name: str, sentence: str, begin: Callable[[Scene], None]) -> Fault:
    return Fault(name, sentence, GROUP, begin)


FAULTS = (
    *(push(force_n) for force_n in PUSHES_N),
    *(push(force_n).for_a_time(0.5) for force_n in PUSHES_N),
    _fault("friction x 10", "The rail's friction grows tenfold.", partial(rubs, factor=10.0)),
    *(
        _fault(f"thrust {percent:+d} %", f"The sufferer's thrust changes by {percent:+d} %.",
               partial(thrusts, factor=1.0 + 0.01 * percent))
        for percent in (-5, -10, -20, -30, 10, 20, 40)
    ),
    _fault("battery sags", "Both motors lose 2 % of their thrust a second, down to half.",
           partial(sags, per_s=SAG_PER_S)),
    *(
        _fault(f"wake x {factor}", f"The wake's force becomes {factor} times as strong.",
               partial(wake_grows, factor=float(factor)))
        for factor in (2, 3)
    ),
    *(
        _fault(f"mass {percent:+d} %", f"The sufferer's mass changes by {percent:+d} %.",
               partial(weighs, factor=1.0 + 0.01 * percent))
        for percent in (10, 20, -10, -20)
    ),
    _fault("spool lag x 2", "The sufferer's motor follows half as fast.",
           partial(lags, factor=2.0)),
)  # fmt: skip
