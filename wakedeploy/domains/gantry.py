"""Gantry flights faster than real time: the loop of the rig around the simulated plant.

In: a rig, a seed, perhaps a package or an oracle for the feedforward, and hooks that hide effects.
Out: a run log with the columns of a real flight, or an episode set cut from many of them.
"""

import datetime
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from runtime.loop.loop import Loop
from runtime.loop.pilot import FORCE, OBSERVATION, LogValue, observation
from runtime.loop.prediction_worker import Predictions
from runtime.predictor import PackagePredictor
from runtime.reference import FlightPlan, random_plan
from runtime.request import require_fit
from runtime.run import metadata
from runtime.simulated import OracleForecast, PackageForecast, SimulatedGantry
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.package import Package, read_package
from wakedeploy.core.parallel import parallel_map
from wakedeploy.core.rig import LOOP_RATE_HZ, Rig
from wakedeploy.core.runlog import RunLog
from wakedeploy.core.version import VERSION
from wakedeploy.domains.domain import Setting, Simulated
from wakedeploy.domains.split import split_in_order
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.physics.gantry import (
    CommandHook,
    ForceHook,
    GantryPlant,
    SensorHook,
    WakeHook,
)
from wakedeploy.rig.file import default_rig

WINDOW_S = 0.5
EPISODE_S = 25.0
NO_TIME = datetime.datetime.fromtimestamp(0, datetime.UTC)  # of a simulated flight: it has none
_LONGEST_LEAD_S = 1.0


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
    after; a failsafe ends it earlier, as at the rig. Feedforward: none, from a `package`, or the
    true wake force `lead_oracle_s` ahead. `plan` replaces the random references. Hooks: see
    `wakedeploy.physics.gantry`.

    Raises UnusableInput for a package that does not fit the loop, an impossible lead, or package
    and oracle together.
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
    world = SimulatedGantry(plant, truth=truth, seed=seed)
    rows = Rows()
    loop = Loop(
        model,
        world,
        world,
        plan if plan is not None else random_plan(model, seconds, seed),
        forecasts_from(plant, opened, lead_oracle_s, model),
        rows,
        world,
        is_timed=False,
    )
    loop.run()
    # A simulated flight happens at no time of day: the same seed gives the same file.
    facts = metadata(model, opened, seed=seed, started=NO_TIME, simulated=True)
    oracle = {} if lead_oracle_s is None else {"lead_oracle_s": f"{lead_oracle_s:g}"}
    return RunLog.from_rows(rows.rows, facts | oracle)


class Rows:
    """Where the loop's rows go: a list."""

    error: str | None = None

    def __init__(self) -> None:
        self.rows: list[Mapping[str, LogValue]] = []

    def put(self, row: Mapping[str, LogValue]) -> None:
        """Keep one row."""
        self.rows.append(row)


def forecasts_from(
    plant: GantryPlant, package: Package | None, lead_oracle_s: float | None, model: Rig
) -> Predictions | None:
    """Where the feedforward's force comes from: nowhere, the truth, or a package."""
    if package is not None:
        require_fit(package.manifest, model, allow_lead_mismatch=True)
        return PackageForecast(PackagePredictor(package))
    if lead_oracle_s is None:
        return None
    if not 0.0 <= lead_oracle_s <= _LONGEST_LEAD_S:
        raise UnusableInput(
            f"lead_oracle_s = {lead_oracle_s!r}: must lie within 0 and {_LONGEST_LEAD_S:g} s."
        )
    return OracleForecast(plant, lead_oracle_s)


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
    rig: Rig | None = None,
    *,
    minutes: float,
    seed: int,
    packages: Sequence[Path] = (),
    progress: Callable[[int, int], None] | None = None,
    workers: int = 2,
) -> EpisodeSet:
    """Simulate `minutes` of flight in episodes of 25 s, split by episode.

    Half fly PID alone, the other half with feedforward: from `packages` in turn where given, else
    from the true force at lead 0 and at the rig's lead. So a predictor meets the motion that its
    own feedforward will cause. `progress(done, total)` is called as flights finish.
    """
    truth = rig if rig is not None else default_rig()
    count = max(3, round(minutes * 60.0 / EPISODE_S))
    jobs = [_job(truth, seed, i, packages) for i in range(count)]
    steps = progress or (lambda done, total: None)
    episodes = parallel_map(_fly_episode, jobs, workers=workers, steps=steps)
    return _as_set(truth, seed, minutes, episodes, packages)


def _job(rig: Rig, seed: int, index: int, packages: Sequence[Path]) -> _Job:
    oracle_s, package = None, None
    if index % 2 == 1 and packages:
        package = packages[(index // 2) % len(packages)]
    elif index % 2 == 1:
        oracle_s = default_lead_s(rig) if (index // 2) % 2 else 0.0
    return _Job(rig, 1_000_000 * (seed + 1) + index, oracle_s, package, f"flight{index:04d}")


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
        split=split_in_order([e.name for e in episodes]),
        episodes=tuple(episodes),
        provenance={
            "generator": f"wakedeploy {VERSION} gantry",
            "seed": seed,
            "minutes": minutes,
            "rig_sha256": rig.sha256,
            "default_lead_s": default_lead_s(rig),
            "packages": [read_package(path).manifest.graph_sha256 for path in packages],
        },
    )


DOMAIN = Simulated(
    main="force_z_n",
    help_text="""Fly the simulated gantry closed loop: half PID alone, half with feedforward.

The feedforward is the true force, now and at the rig's lead, unless packages are given.""",
    examples=("--out sets/gantry --minutes 30 --seed 0", "--out sets/second --package gru.onnx"),
    make=make_set,
    settings=(
        Setting("rig", "rig", "Default: the default rig."),
        Setting(
            "packages",
            "packages",
            "Fly this predictor in the flights with feedforward; may be repeated.",
        ),
    ),
)
