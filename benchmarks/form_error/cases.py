"""The cases: which gantry, which effect, and how its flights are flown and kept.

In: a `Case`. Out: the rig file that the workflow gets and one run log per flight, kept on disk.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.flown_again import TRIES, flown_again
from benchmarks.form_error.equations import COULOMB, LUGRE, STRIBECK, Numbers
from benchmarks.form_error.plant import Build, Electronics, FormPlant
from benchmarks.form_error.profiles import AIR_DENSITY_KGPM3, Jet, Wake, jet_of
from runtime.loop.loop import Loop
from runtime.reference import random_plan
from runtime.run import metadata
from runtime.simulated import SimulatedGantry
from wakedeploy.core.rig import Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.domains.gantry import NO_TIME, Rows
from wakedeploy.physics.constants import constants_of, moved_thrust, spreads_of
from wakedeploy.physics.rail import GRAVITY_MPS2
from wakedeploy.rig.file import default_rig

FLIGHTS, SECONDS = 7, 20.0
FRICTIONS: Mapping[str, Mapping[str, float]] = {
    "coulomb": {"friction": COULOMB},
    "stribeck": {"friction": STRIBECK, "stribeck_mps": 0.02},
    "lugre": {"friction": LUGRE, "stribeck_mps": 0.02, "bristle_m": 5e-5},
    "along": {"friction": COULOMB, "along_rail": 0.3},
}
MOTORS: Mapping[str, Mapping[str, float]] = {
    "first": {},
    "second": {"winding_share": 0.12},
    "bent": {"lag_bend": 0.25},
}
SENSORS: Mapping[str, Mapping[str, float]] = {
    "point": {},
    "window": {"window_s": 0.018},
    "bus": {"stamp_jitter_s": 0.0007},
}
NOISES: Mapping[str, Mapping[str, float]] = {
    "steady": {},
    "bursts": {"bursts": 0.5},
    "far": {"noise_m": 0.003, "noise_per_m": 0.002},
}
_CONSTANT_OF = {  # effect parameters that are a constant of the rig
    "crosswind-offset.offset_m": "offset_m",
    "wake-deflection.deflection_s": "deflection_s",
    "battery-sag.sag_per_s": "sag_per_s",
    "axial-inflow-loss.loss_s_per_m": "inflow_s_per_m",
    "wake-inflow-loss.loss_s_per_m": "wake_inflow_s_per_m",
    "ground-effect.gain": "ground_gain",
    "ground-effect.height_m": "ground_height_m",
    "tether-spring.stiffness_n_per_m": "tether_n_per_m",
    "tether-spring.slack_m": "tether_slack_m",
    "added-mass.mass_kg": "added_mass_kg",
}


@dataclass(frozen=True)
class Case:
    """A gantry by its families, the misfit of its jet, and what is hidden in it.

    `effects` are sizes by `effect.parameter` or by a constant's name; `outside` are forces that no
    library knows, by field of `Numbers`. `is_calibrated` moves the constants within their spreads.
    """

    seed: int
    jet: str = "same"
    misfit: float = 0.0
    friction: str = "coulomb"
    motor: str = "first"
    sensor: str = "point"
    noise: str = "steady"
    effects: Mapping[str, float] = field(default_factory=dict)
    outside: Mapping[str, float] = field(default_factory=dict)
    is_calibrated: bool = True

    @property
    def name(self) -> str:
        """Short, and one for each case."""
        parts = [self.jet, f"{100 * self.misfit:g}", self.friction, self.motor, self.sensor]
        what = [k.partition(".")[0] for k in (*self.effects, *self.outside)]
        return "-".join([*parts, self.noise, *dict.fromkeys(what), f"s{self.seed}"])

    @property
    def digest(self) -> str:
        """The hash of all that decides the case's flights."""
        text = json.dumps(asdict(self), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:12]


def flights_of(case: Case, folder: Path, rig: Rig | None = None) -> list[Path]:
    """The case's logs in the folder, flown where they are not there yet; `rig.toml` beside them.

    A motor that is far slower than its rig file can look at take-off as if it had no thrust.
    """
    rig = rig if rig is not None else default_rig()
    place = folder / f"{case.name}-{case.digest}"
    place.mkdir(parents=True, exist_ok=True)
    paths = [place / f"flight{i}.mcap" for i in range(FLIGHTS)]
    for i, path in enumerate(paths):
        if not path.is_file():
            seeds = (100 * case.seed + i + again * FLIGHTS for again in range(TRIES))
            flown_again(partial(fly, case, rig), seeds).without_truth().write_mcap(path)
    rig.write(place / "rig.toml")
    return paths


def fly(case: Case, rig: Rig, seed: int, seconds: float = SECONDS) -> RunLog:
    """One flight of the rig's own loop around the case's gantry, truth columns included."""
    plant: Any = FormPlant(build_of(case, rig), seed=seed)
    world = SimulatedGantry(plant, truth=rig, seed=seed)
    rows = Rows()
    plan = random_plan(rig, seconds, seed)
    Loop(rig, world, world, plan, None, rows, world, is_timed=False).run()
    flight_metadata = metadata(rig, None, seed=seed, started=NO_TIME, simulated=True)
    return RunLog.from_rows(rows.rows, flight_metadata)


def build_of(case: Case, rig: Rig) -> Build:
    """The case's gantry: the rig file's constants moved within their spreads, then its forms."""
    c = _constants(case, rig)
    hidden = {_CONSTANT_OF[k]: v for k, v in case.effects.items() if k in _CONSTANT_OF}
    numbers = Numbers(
        mass_kg=rig.sufferer.mass_kg,
        travel_m=rig.sufferer.travel_m,
        source_height_m=rig.source.height_m,
        half_rho_area=0.5 * AIR_DENSITY_KGPM3 * rig.wake.drag_area_m2,
        reference_thrust_n=rig.wake.reference_thrust_n,
        source_up_s=c["spool.source.up_s"],
        source_down_s=c["spool.source.down_s"],
        sufferer_up_s=c["spool.sufferer.up_s"],
        sufferer_down_s=c["spool.sufferer.down_s"],
        coulomb_n=c["rail.coulomb_n"],
        stiction_n=max(c["rail.stiction_n"], c["rail.coulomb_n"]),
        viscous_n_per_mps=c["rail.viscous_n_per_mps"],
    )._replace(**FRICTIONS[case.friction], **MOTORS[case.motor], **hidden, **case.outside)
    return Build(
        numbers,
        _electronics(case, rig, c),
        jet_of_case(case, rig),
        _curve(rig, c, "source"),
        _curve(rig, c, "sufferer"),
    )


def jet_of_case(case: Case, rig: Rig) -> Jet:
    """The case's jet, with its misfit."""
    c = _constants(case, rig)
    names = ("speed_mps", "diffusivity_m2ps", "decay_per_s", "strength", "width_m")
    wake = Wake(**{n: c[f"wake.{n}"] for n in names}, drag_area_m2=rig.wake.drag_area_m2)
    return _jet(wake, case.jet, case.misfit)


@cache
def _jet(wake: Wake, family: str, misfit: float) -> Jet:
    return jet_of(wake, family, misfit)


def _constants(case: Case, rig: Rig) -> dict[str, float]:
    values, spreads = constants_of(rig), spreads_of(rig)
    rng = np.random.default_rng([case.seed, 5])
    for name, spread in spreads.items():
        drawn = values[name] + spread * float(np.clip(rng.standard_normal(), -2.0, 2.0))
        if case.is_calibrated:
            continue_at = 0.1 * values[name]
            is_positive = name.startswith(("rail.", "spool.", "wake."))
            values[name] = max(drawn, continue_at) if is_positive else drawn
    for name, value in case.effects.items():
        if name in values:
            values[name] = value
    return values


def _electronics(case: Case, rig: Rig, c: Mapping[str, float]) -> Electronics:
    plain = Electronics(
        command_delay_s=abs(c["command.delay_s"]),
        period_s=rig.range_sensor.period_s,
        noise_m=rig.range_sensor.noise_m,
        resolution_m=rig.range_sensor.resolution_m,
        bias_m=c["range.bias_m"],
        scale=c["range.scale"],
        stale_s=abs(c["range.delay_s"]),
        delay_s=0.5 * rig.latency.round_trip_s,
        steps_per_m=rig.stepper.steps_per_m,
        idle_us=rig.limits.pulse_us[0],
    )
    return replace(plain, **SENSORS[case.sensor], **NOISES[case.noise])


def _curve(rig: Rig, c: Mapping[str, float], motor: str) -> tuple[Any, Any]:
    curve = getattr(rig.thrust, motor)
    hover_n = rig.sufferer.mass_kg * GRAVITY_MPS2
    scale, exponent = (c[f"thrust.{motor}.{part}"] for part in ("scale", "exponent"))
    moved = moved_thrust(np.array(curve.thrust_n), scale, exponent, hover_n)
    return np.array(curve.pulse_us, float), moved
