"""What a run is asked for, and the two judgements that come before anything is opened."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from runtime.compiled.folder import CFolder
from runtime.flyable import Flyable, read_flyable, require_tried
from runtime.loop.loop import PERIOD_S, require_wait
from runtime.loop.pilot import FORCE, OBSERVATION
from runtime.loop.tally import Tally
from runtime.reference import FlightPlan, random_plan, require_plan_fits
from runtime.reference_file import read_reference
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.manifest import ForceChannel, Manifest
from wakedeploy.core.package import Package
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import read_rig

LEAD_TOLERANCE_S = 0.5 * PERIOD_S

Tell = Callable[[Tally], None]
Show = Callable[[float, float], None]
Warn = Callable[[str], None]
AsC = Callable[[Package, Callable[[], None]], CFolder]


@dataclass(frozen=True)
class RunRequest:
    """What to fly, on what. `port` None: the virtual gantry, with `plant_rig` as its truth.

    The virtual gantry flies in simulated time, in lockstep with the loop; with `wall_clock` it is a
    process of its own behind a pseudo-terminal, in real time. `realtime` None takes what priority
    the computer permits, wherever time is real.

    `rig_path` is the file that `rig` was read from; it is read again where a run has stood by.
    `reference`, a file, or `plan` replaces the random plan of `seconds` and `seed`. `range_socket`
    beside a `port` reads range samples from a plant process instead of I²C. With `firmware` the
    virtual gantry's UNO is the compiled sketch on a simulated chip; its sufferer lies on a spacer
    of `spacer_m`. A `log` that is a folder, or has no suffix, gets a file named by the flight's
    start. With an
    `arm_file` the run stands by until that file appears. `wake_off` leaves the source idle.
    `plant_seed` is the virtual gantry's chance, `seed` unless given; `notes` go into the log's
    metadata. `as_c` makes the C that flies in a package's place.
    """

    rig: Rig
    seconds: float
    seed: int = 0
    rig_path: Path | None = None
    reference: Path | None = None
    plan: FlightPlan | None = None
    package: Path | None = None
    as_c: AsC | None = None
    port: str | None = None
    wall_clock: bool = False
    range_socket: Path | None = None
    plant_rig: Rig | None = None
    hooks: str | None = None
    firmware: bool = False
    spacer_m: float = 0.0
    log: Path | None = None
    arm_file: Path | None = None
    realtime: bool | None = None
    allow_lead_mismatch: bool = False
    watch_gap: bool = False
    wake_off: bool = False
    plant_seed: int | None = None
    notes: Mapping[str, str] = field(default_factory=dict)

    @property
    def is_virtual(self) -> bool:
        """Whether the run makes its own plant."""
        return self.port is None

    @property
    def in_lockstep(self) -> bool:
        """Whether it flies in simulated time."""
        return self.is_virtual and not self.wall_clock

    @property
    def truth(self) -> Rig:
        """What the virtual gantry is in truth."""
        return self.plant_rig or self.rig

    @property
    def truth_seed(self) -> int:
        """The virtual gantry's chance."""
        return self.seed if self.plant_seed is None else self.plant_seed

    def current(self) -> "RunRequest":
        """The request with the rig as its file is now; the plant that was started stays."""
        if self.rig_path is None:
            return self
        return replace(self, rig=read_rig(self.rig_path), plant_rig=self.truth)


def wanted(
    request: RunRequest, waiting: Callable[[], None] = lambda: None
) -> tuple[FlightPlan, Flyable | None]:
    """What is to be flown and with what, read, judged and tried; `waiting` is called meanwhile.

    A package that nobody checked on this computer is as good as one that fails its check. Its trial
    takes a second or two with the motors off, once for each package in a process.
    """
    plan = _plan(request)
    require_plan_fits(plan, request.rig)
    if request.package is None:
        return plan, None
    package = read_flyable(request.package)
    require_fit(package.manifest, request.rig, request.allow_lead_mismatch)
    require_wait(request.rig)
    if request.as_c is not None and isinstance(package, Package):
        package = request.as_c(package, waiting)
    require_tried(package, waiting)
    return plan, package


def require_fit(manifest: Manifest, rig: Rig, allow_lead_mismatch: bool = False) -> None:
    """UnusableInput when a package cannot serve this loop: rate, channels, forces, or lead."""
    if abs(manifest.rate_hz - LOOP_RATE_HZ) > 1e-6:
        raise UnusableInput(
            f"The package runs at {manifest.rate_hz:g} Hz and the gantry's loop at "
            f"{LOOP_RATE_HZ:g} Hz; train one on gantry data."
        )
    for word, given, needed in (
        ("observes", manifest.observation, OBSERVATION),
        ("predicts", manifest.force, FORCE),
    ):
        if tuple((channel.name, channel.unit) for channel in given) != needed:
            named = ", ".join(f"{channel.name} [{channel.unit}]" for channel in given)
            raise UnusableInput(
                f"The package {word} {named}: it is not for the gantry; train one on gantry data."
            )
    _require_possible_force(manifest.force[0], rig)
    if abs(manifest.lead_s - default_lead_s(rig)) > LEAD_TOLERANCE_S and not allow_lead_mismatch:
        raise UnusableInput(
            f"The package predicts {manifest.lead_s:g} s ahead and this rig's commands act after "
            f"{default_lead_s(rig):g} s; train with --lead {default_lead_s(rig):g}, or fly it all "
            "the same with --allow-lead-mismatch."
        )


def _require_possible_force(force: ForceChannel, rig: Rig) -> None:
    """A wake does not push harder than what makes it, nor is a harder push to be answered."""
    strongest_n = max(curve.thrust_n[-1] for curve in (rig.thrust.source, rig.thrust.sufferer))
    largest_n = max(abs(force.min), abs(force.max))
    if largest_n > strongest_n:
        raise UnusableInput(
            f"The package was trained on forces of up to {largest_n:g} N, and no motor of this rig "
            f"gives more than {strongest_n:g} N: train one on this rig's data."
        )


def _plan(request: RunRequest) -> FlightPlan:
    """What is given, the reference file's plan, or a random one; without wake if that is asked."""
    if request.plan is not None:
        plan = request.plan
    elif request.reference is not None:
        plan = read_reference(request.reference, request.rig)
    else:
        plan = random_plan(request.rig, request.seconds, request.seed)
    return plan.without_wake(request.rig.limits.pulse_us[0]) if request.wake_off else plan
