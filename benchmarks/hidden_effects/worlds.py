"""A case as files: what the workflow gets in one folder, the truth in a file outside it."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.flown_again import ENOUGH_S, TRIES, flown_again
from benchmarks.hidden_effects.cases import FLIGHT_S, FLIGHTS, Case
from benchmarks.hidden_effects.outside import OUTSIDE
from benchmarks.hidden_effects.second_plant import (
    Constants,
    Curve,
    Numbers,
    SecondPlant,
    Sensing,
    Wake,
)
from runtime.loop.loop import Loop
from runtime.reference import random_plan
from runtime.run import metadata
from runtime.simulated import SimulatedGantry
from wakedeploy.core.files import write_text_whole
from wakedeploy.core.package import read_package
from wakedeploy.core.rig import Effect, EffectParameter, Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.domains.gantry import NO_TIME, Rows, forecasts_from, record
from wakedeploy.physics.constants import constants_of, with_constants
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.physics.rail import GRAVITY_MPS2

_PLACELESS = {  # constants without a place in a rig file: the effects that state them
    "command.delay_s": ("command-latency", "latency_s"),
    "range.bias_m": ("range-bias", "bias_m"),
    "range.scale": ("range-scale", "scale"),
    "range.delay_s": ("range-delay", "delay_s"),
}
_NUMBERS = {  # effect parameters of the second plant: its own names
    "battery-sag.sag_per_s": "sag_per_s",
    "axial-inflow-loss.loss_s_per_m": "inflow_s_per_m",
    "wake-inflow-loss.loss_s_per_m": "wake_inflow_s_per_m",
    "recirculation.loss": "recirculation",
    "recirculation.height_m": "recirculation_height_m",
    "tether-spring.stiffness_n_per_m": "tether_n_per_m",
    "tether-spring.slack_m": "tether_slack_m",
    "added-mass.mass_kg": "added_mass_kg",
    "crosswind-offset.offset_m": "offset_m",
    "wake-deflection.deflection_s": "deflection_s",
    "lost-steps.lost_per_m": "lost_steps",
    "belt-backlash.backlash_m": "backlash_m",
}
_SENSING = {
    "pwm-dead-band.band_us": "dead_band_us",
    "pwm-quantisation.step_us": "quantum_us",
    "range-drift.drift_mps": "drift_mps",
}
_GROUND_M = (0.0, 0.03, 0.06, 0.1, 0.14, 0.18, 0.23, 0.28, 0.34, 0.4, 0.5, 0.6, 0.75, 0.9, 1.2)


def write_world(
    case: Case, folder: Path, truth: Path, *, flights: int = FLIGHTS, seconds: float = FLIGHT_S
) -> list[Path]:
    """Fly the case: rig.toml and one log per flight in `folder`, the truth in `truth`."""
    if truth.resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"{truth} lies in {folder}, where the workflow could see it")
    folder.mkdir(parents=True, exist_ok=True)
    case.model_rig.write(folder / "rig.toml")
    paths, modes = [], []
    for number in range(flights):
        log = flight(case, number, seconds)
        modes.append(sorted(set(map(str, log["mode"]))))
        path = folder / f"flight{number}.mcap"
        log.without_truth().write_mcap(path)
        paths.append(path)
    truth_record = asdict(case) | {"constants": case.truth_constants(), "modes": modes}
    write_text_whole(truth, json.dumps(truth_record, indent=1) + "\n")
    return paths


def flight(case: Case, number: int, seconds: float = FLIGHT_S) -> RunLog:
    """One flight of a case, truth columns included; deterministic.

    One that the supervisor ends at take-off is flown again, as at a rig.
    """
    seeds = (100 * case.seed + number + again * FLIGHTS for again in range(TRIES))
    enough_s = min(ENOUGH_S, 0.5 * seconds)
    return flown_again(lambda seed: fly(case, seed, seconds), seeds, enough_s)


def fly(
    case: Case,
    seed: int,
    seconds: float = FLIGHT_S,
    *,
    believed: Rig | None = None,
    package: Path | None = None,
) -> RunLog:
    """A flight of the case's plant under any pilot, truth columns included; deterministic by seed.

    `believed` is what estimator and controller go by, the case's own rig file unless given;
    `package` forecasts for the feedforward, PID flies alone without. Raises UnusableInput for a
    package that does not fit the loop.
    """
    model = believed if believed is not None else case.model_rig
    if case.plant == "second":
        return _second_flight(case, seed, seconds, model, package)
    truth = true_rig(case)
    hooks: dict[str, Any] = {}
    for name, size in case.outside.items():
        hooks |= OUTSIDE[name].hooks(size, truth)
    return record(truth, seconds=seconds, seed=seed, model_rig=model, package=package, **hooks)


def true_rig(case: Case) -> Rig:
    """The first plant's rig: constants off by calibration, the hidden effects as entries."""
    rig = with_constants(case.model_rig, case.truth_constants())
    effects: dict[str, Mapping[str, float]] = dict(case.effects)
    neutral = constants_of(case.model_rig)
    for constant, (name, parameter) in _PLACELESS.items():
        value = case.truth_constants()[constant]
        if value != neutral[constant] and name not in effects:
            effects[name] = {parameter: value}
    return rig.model_copy(update={"effect": tuple(_entry(n, v) for n, v in effects.items())})


def second_constants(case: Case) -> Constants:
    """The second plant's numbers for a case."""
    constants = case.truth_constants()
    numbers: dict[str, float] = {}
    sensing: dict[str, float] = {}
    for name, values in case.effects.items():
        for p in LIBRARY[name].parameters:
            if p.constant is not None:
                constants[p.constant] = values[p.name]
            elif f"{name}.{p.name}" in _NUMBERS:
                numbers[_NUMBERS[f"{name}.{p.name}"]] = values[p.name]
            elif f"{name}.{p.name}" in _SENSING:
                sensing[_SENSING[f"{name}.{p.name}"]] = values[p.name]
    for name, size in case.outside.items():
        numbers |= {field: size * share for field, share in OUTSIDE[name].fields.items()}
    rig = case.model_rig
    return Constants(
        numbers=_numbers(rig, constants)._replace(**numbers),
        sensing=_sensing(rig, constants)._replace(**sensing),
        wake=Wake(
            **{k: constants[f"wake.{k}"] for k in Wake._fields if f"wake.{k}" in constants},
            drag_area_m2=rig.wake.drag_area_m2,
            reference_thrust_n=rig.wake.reference_thrust_n,
        ),
        source=_curve(rig, constants, "source"),
        sufferer=_curve(rig, constants, "sufferer"),
        idle_us=rig.limits.pulse_us[0],
        ground_height_m=_GROUND_M,
        ground_factor=_ground(case),
    )


def _second_flight(
    case: Case, seed: int, seconds: float, model: Rig, package: Path | None
) -> RunLog:
    plant: Any = SecondPlant(second_constants(case), seed=seed)
    world = SimulatedGantry(plant, truth=case.model_rig, seed=seed)
    opened = read_package(package) if package is not None else None
    forecast = forecasts_from(plant, opened, None, model)
    rows = Rows()
    plan = random_plan(model, seconds, seed)
    Loop(model, world, world, plan, forecast, rows, world, is_timed=False).run()
    flight_metadata = metadata(model, opened, seed=seed, started=NO_TIME, simulated=True)
    return RunLog.from_rows(rows.rows, flight_metadata)


def _numbers(rig: Rig, constants: Mapping[str, float]) -> Numbers:
    return Numbers(
        mass_kg=rig.sufferer.mass_kg,
        gravity_mps2=GRAVITY_MPS2,
        rotor_radius_m=rig.sufferer.rotor_radius_m,
        travel_m=rig.sufferer.travel_m,
        source_height_m=rig.source.height_m,
        source_up_s=constants["spool.source.up_s"],
        source_down_s=constants["spool.source.down_s"],
        sufferer_up_s=constants["spool.sufferer.up_s"],
        sufferer_down_s=constants["spool.sufferer.down_s"],
        coulomb_n=constants["rail.coulomb_n"],
        stiction_n=constants["rail.stiction_n"],
        viscous_n_per_mps=constants["rail.viscous_n_per_mps"],
    )


def _sensing(rig: Rig, constants: Mapping[str, float]) -> Sensing:
    disturbance = rig.disturbance
    return Sensing(
        noise_m=rig.range_sensor.noise_m,
        period_s=rig.range_sensor.period_s,
        resolution_m=rig.range_sensor.resolution_m,
        delay_s=0.5 * rig.latency.round_trip_s,
        bias_m=constants["range.bias_m"],
        scale=constants["range.scale"],
        stale_s=constants["range.delay_s"],
        hold_s=constants["range.hold_s"],
        outlier_probability=disturbance.outlier_probability,
        outlier_size_m=disturbance.outlier_size_m,
        steps_per_m=rig.stepper.steps_per_m,
        frame_s=constants["disturbance.esc_frame_s"],
        command_delay_s=constants["command.delay_s"],
        turbulence_fraction=disturbance.turbulence_fraction,
        turbulence_time_s=disturbance.turbulence_time_s,
    )


def _curve(rig: Rig, constants: Mapping[str, float], motor: str) -> Curve:
    table = getattr(rig.thrust, motor)
    scale, exponent = (constants[f"thrust.{motor}.{part}"] for part in ("scale", "exponent"))
    return Curve(table.pulse_us, table.thrust_n, scale, exponent)


def _ground(case: Case) -> tuple[float, ...]:
    """The ground effect's table: the thrust's factor at `_GROUND_M`, which is what is tabulated."""
    values = case.effects.get("ground-effect", {"gain": 0.0, "height_m": 0.1})
    return tuple(1.0 + values["gain"] / (1.0 + (z / values["height_m"]) ** 2) for z in _GROUND_M)


def _entry(name: str, values: Mapping[str, float]) -> Effect:
    units = {p.name: p.unit for p in LIBRARY[name].parameters}
    stated = {k: EffectParameter(value=v, unit=units[k]) for k, v in values.items()}
    return Effect(name=name, parameters=stated)
