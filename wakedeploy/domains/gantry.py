"""Gantry flights faster than real time: the runtime's pilot and MCU around the simulated plant.

In: a rig, a seed, perhaps a package or an oracle for the feedforward, and hooks that hide effects.
Out: a run log with the columns of a real flight, or an episode set cut from many of them.
"""

import datetime
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import wakedeploy
from runtime.controller import Command
from runtime.estimator import Measurement
from runtime.mcu import Mcu, Outputs
from runtime.pilot import (
    FORCE,
    OBSERVATION,
    LogValue,
    Pilot,
    observation,
    resting_reference,
    tick_row,
)
from runtime.predictor import PackagePredictor
from runtime.reference import FlightPlan, Reference, random_plan
from runtime.run import metadata, require_fit
from wakedeploy.episodes import Channel, Episode, EpisodeSet
from wakedeploy.errors import UnusableInput
from wakedeploy.package import Package, read_package
from wakedeploy.physics.gantry import (
    INNER_RATE_HZ,
    CommandHook,
    ForceHook,
    GantryPlant,
    SensorHook,
    WakeHook,
)
from wakedeploy.rig import LOOP_RATE_HZ, Rig, default_rig
from wakedeploy.runlog import RunLog

WINDOW_S = 0.5
EPISODE_S = 25.0
_INNER_PER_TICK = round(INNER_RATE_HZ / LOOP_RATE_HZ)
_NO_TIME = datetime.datetime.fromtimestamp(0, datetime.UTC)
_COMPUTE_S = 0.002  # what the Pi takes between reading and writing

Forecast = Callable[[GantryPlant, np.ndarray], float | None]


def record(
    rig: Rig | None,
    *,
    seconds: float,
    seed: int,
    package: Path | Package | None = None,
    lead_oracle_s: float | None = None,
    command_hook: CommandHook | None = None,
    force_hook: ForceHook | None = None,
    sensor_hook: SensorHook | None = None,
    wake_hook: WakeHook | None = None,
    plan: FlightPlan | None = None,
    model_rig: Rig | None = None,
) -> RunLog:
    """Fly the simulated gantry closed loop and return its run log, deterministic by seed.

    `rig` is the plant's truth (None: the default rig); `model_rig`, what estimator and controller
    believe, is the same unless given. The flight lasts `seconds`, with the rig's rest before and
    after. Feedforward: none, from a `package`, or the true wake force `lead_oracle_s` ahead. `plan`
    replaces the random references. Hooks: see `wakedeploy.physics.gantry`.

    Raises UnusableInput for a package that does not fit the loop, or package and oracle together.
    """
    truth = rig if rig is not None else default_rig()
    model = model_rig if model_rig is not None else truth
    if package is not None and lead_oracle_s is not None:
        raise UnusableInput("Give a package or lead_oracle_s, not both.")
    plant = GantryPlant(
        truth,
        seed=seed,
        command_hook=command_hook,
        force_hook=force_hook,
        sensor_hook=sensor_hook,
        wake_hook=wake_hook,
    )
    opened = read_package(Path(package)) if isinstance(package, str | Path) else package
    flight = _Flight(
        truth,
        model,
        plant,
        plan if plan is not None else random_plan(truth, seconds, seed),
        _forecast(opened, lead_oracle_s, model),
        opened.manifest.lead_s if opened is not None else lead_oracle_s or 0.0,
        seed,
    )
    # A simulated flight happens at no time of day: the same seed gives the same file.
    told = metadata(model, opened, seed=seed, started=_NO_TIME, simulated=True)
    oracle = {} if lead_oracle_s is None else {"lead_oracle_s": f"{lead_oracle_s:g}"}
    return RunLog.from_rows(flight.fly(), told | oracle)


class _Flight:
    """The state of one simulated flight: plant, MCU, pilot and what is under way between them."""

    def __init__(
        self,
        truth: Rig,
        model: Rig,
        plant: GantryPlant,
        plan: FlightPlan,
        forecast: Forecast,
        lead_s: float,
        seed: int,
    ) -> None:
        self._rig, self._plant, self._plan, self._forecast = truth, plant, plan, forecast
        self._pilot, self._mcu = Pilot(model, lead_s), Mcu(truth)
        self._state = self._pilot.initial(0.0)
        idle_us = truth.limits.pulse_us[0]
        self._outputs = Outputs(idle_us, idle_us, 0.0)
        self._under_way: deque[tuple[float, int, Command]] = deque()
        self._clock = np.random.default_rng(np.random.SeedSequence([seed, 2]))
        self._reported: dict[str, LogValue] = {}
        self._last_sample_s, self._repeats = -np.inf, 0
        self._mcu.arm(0.0)
        self._report(0.0)

    def fly(self) -> list[dict[str, LogValue]]:
        """All rows: rest, flight, rest."""
        rest = round(self._rig.disturbance.rest_s * LOOP_RATE_HZ)
        phases = [None] * rest + list(range(len(self._plan))) + [None] * rest
        return [self._tick(tick, planned) for tick, planned in enumerate(phases)]

    def _tick(self, tick: int, planned: int | None) -> dict[str, LogValue]:
        """Read → estimate → predict → control → write → record, then the plant until the next."""
        jitter_s = self._rig.disturbance.clock_jitter_s * float(self._clock.standard_normal())
        t_s = max(tick / LOOP_RATE_HZ + float(np.clip(jitter_s, -0.003, 0.003)), 0.0)
        aim = (
            resting_reference(self._rig)
            if planned is None
            else self._plan.at(planned, self._pilot.preview_s)
        )
        measured = self._read(t_s)
        self._state = self._pilot.estimate(self._state, measured)
        predicted_n = self._predict(aim)
        if planned is None:
            self._state, command, terms = self._pilot.rest(self._state)
        else:
            self._state, command, terms = self._pilot.control(
                self._state, aim, None if predicted_n is None else -predicted_n
            )
        row = tick_row(tick, measured, self._state, aim, command, terms) | self._reported
        row |= {
            "force_pred_n": predicted_n,
            "mode": "ARMED" if planned is None else "RUNNING",
            "true_wake_force_n": self._plant.wake_force_n,
            "true_hook_force_n": self._plant.hook_force_n,
            "true_z_m": self._plant.z_m,
        }
        arrives_s = t_s + _COMPUTE_S + 0.5 * self._rig.latency.round_trip_s
        self._under_way.append((arrives_s, tick, command))
        for _ in range(_INNER_PER_TICK):
            self._inner_step()
        return row

    def _read(self, t_s: float) -> Measurement:
        sample = self._plant.range_sample()
        self._repeats = self._repeats + 1 if sample.sensor_time_s == self._last_sample_s else 0
        self._last_sample_s = sample.sensor_time_s
        return Measurement(
            t_s, sample.range_m, t_s - sample.sensor_time_s, self._repeats, self._plant.steps
        )

    def _predict(self, aim: Reference) -> float | None:
        predicted_n = self._forecast(self._plant, self._pilot.observe(self._state, aim))
        return predicted_n if predicted_n is not None and np.isfinite(predicted_n) else None

    def _inner_step(self) -> None:
        plant, mcu = self._plant, self._mcu
        while self._under_way and self._under_way[0][0] <= plant.t_s:
            arrived_s, tick, command = self._under_way.popleft()
            mcu.command(
                arrived_s, tick, command.source_us, command.sufferer_us, command.carriage_mps
            )
            self._report(plant.t_s)
        self._outputs = mcu.advance(plant.t_s, plant.dt_s)
        plant.step(self._outputs.source_us, self._outputs.sufferer_us, self._outputs.carriage_mps)

    def _report(self, t_s: float) -> None:
        """The MCU's answer to the last command, as the next tick will log it."""
        plant = self._plant
        self._reported = {
            "source_applied_us": plant.source_applied_us,
            "sufferer_applied_us": plant.sufferer_applied_us,
            "applied_time_s": plant.pulse_applied_s,
            "seq_echo": self._mcu.status.last_sequence,
            "round_trip_s": self._rig.latency.round_trip_s,
            "faults": "",
            "homed": int(abs(plant.x_m) < 1e-3),
        }


def _forecast(package: Package | None, lead_oracle_s: float | None, rig: Rig) -> Forecast:
    """Where the feedforward's force comes from: nowhere, the truth, or a package."""
    if lead_oracle_s is not None:
        lead_s = lead_oracle_s
        return lambda plant, _: plant.wake_force_ahead(lead_s)
    if package is None:
        return lambda *_: None
    return _from_package(package, rig)


def _from_package(package: Package, rig: Rig) -> Forecast:
    require_fit(package.manifest, rig, allow_lead_mismatch=True)
    predictor = PackagePredictor(package)

    def forecast(_: GantryPlant, observed: np.ndarray) -> float | None:
        force_n = float(predictor.step(observed)[0])
        return force_n if predictor.ready else None

    return forecast


def episode_from_log(log: RunLog, rig: Rig, name: str) -> Episode:
    """The flight in a simulated log as an episode: what was observed, the true wake force."""
    flying = np.flatnonzero(np.isin(log["mode"], ("RUNNING", "DEGRADED")))
    columns = [log[c] for c in ("x_m", "z_est_m", "vx_mps", "vz_est_mps", "source_cmd_us")]
    observed = [observation(rig, *(float(c[i]) for c in columns)) for i in flying]
    force = log["true_wake_force_n"][flying].astype(np.float32)[:, None]
    return Episode(name, np.asarray(observed, dtype=np.float32), force, {})


@dataclass(frozen=True)
class _Job:
    rig: Rig
    seed: int
    oracle_s: float | None
    package: Path | None
    name: str


def make_set(
    rig: Rig | None,
    *,
    minutes: float,
    seed: int,
    packages: Sequence[Path] = (),
    progress: Callable[[int, int], None] | None = None,
    workers: int = 2,
) -> EpisodeSet:
    """Simulate `minutes` of flight in episodes of 25 s, split by episode.

    Half fly PID alone; the other half with feedforward, from `packages` in turn where given, else
    from the true force at lead 0 and at the rig's lead, so that a predictor meets the motion that
    its own feedforward will cause. `progress(done, total)` is called as flights finish.
    """
    truth = rig if rig is not None else default_rig()
    count = max(3, round(minutes * 60.0 / EPISODE_S))
    jobs = [_job(truth, seed, i, packages) for i in range(count)]
    episodes: list[Episode] = []
    with ProcessPoolExecutor(max_workers=workers) as pool:
        for episode in pool.map(_fly_episode, jobs):
            episodes.append(episode)
            if progress is not None:
                progress(len(episodes), count)
    return _as_set(truth, seed, minutes, episodes, packages)


def _job(rig: Rig, seed: int, index: int, packages: Sequence[Path]) -> _Job:
    oracle_s, package = None, None
    if index % 2 == 1 and packages:
        package = packages[(index // 2) % len(packages)]
    elif index % 2 == 1:
        oracle_s = rig.default_lead_s if (index // 2) % 2 else 0.0
    return _Job(rig, seed * 100_003 + index, oracle_s, package, f"flight{index:04d}")


def _fly_episode(job: _Job) -> Episode:
    log = record(
        job.rig,
        seconds=EPISODE_S,
        seed=job.seed,
        package=job.package,
        lead_oracle_s=job.oracle_s,
    )
    return episode_from_log(log, job.rig, job.name)


def _as_set(
    rig: Rig, seed: int, minutes: float, episodes: list[Episode], packages: Sequence[Path]
) -> EpisodeSet:
    return EpisodeSet(
        domain="gantry",
        rate_hz=LOOP_RATE_HZ,
        observation=tuple(Channel(*pair) for pair in OBSERVATION),
        force=tuple(Channel(*pair) for pair in FORCE),
        window_s=WINDOW_S,
        loss_weights=(1.0,),
        split={e.name: _split_of(i, len(episodes)) for i, e in enumerate(episodes)},
        episodes=tuple(episodes),
        provenance={
            "generator": f"wakedeploy {wakedeploy.__version__} gantry",
            "seed": seed,
            "minutes": minutes,
            "rig_sha256": rig.sha256,
            "default_lead_s": rig.default_lead_s,
            "packages": [read_package(path).manifest.graph_sha256 for path in packages],
        },
    )


def _split_of(index: int, count: int) -> str:
    """70 % training, 15 % validation, 15 % test, at least one of each, kinds of flight in each."""
    held_out = max(1, round(0.15 * count))
    if index >= count - held_out:
        return "test"
    return "validation" if index >= count - 2 * held_out else "train"
