"""Forces measured from simulated logs, against the truth that the measuring never sees."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from runtime.measured_force import measure, range_offset, thrust_after_spool
from wakedeploy.core.episodes import Channel
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.rig import Effect, EffectParameter
from wakedeploy.core.runlog import RunLog
from wakedeploy.domains.gantry import record
from wakedeploy.domains.gantry_measured import MeasuredSet, measured_set, measured_stretches
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig.file import default_rig

RIG = default_rig()


@pytest.fixture(scope="module")
def logs() -> dict[str, RunLog]:
    return {f"flight{seed}": record(RIG, seconds=15, seed=seed) for seed in range(4)}


@pytest.fixture(scope="module")
def made(logs: dict[str, RunLog]) -> MeasuredSet:
    """The set of all four."""
    return measured_set(logs, RIG, {"flight0": "abc"})


@pytest.fixture(scope="module")
def made_of_one(logs: dict[str, RunLog]) -> MeasuredSet:
    """The set of the first."""
    return measured_set({"flight0": logs["flight0"]}, RIG)


@pytest.mark.whole
def test_errors_are_small_and_the_stated_sd_is_honest(logs: dict[str, RunLog]) -> None:
    _, measured = measure([log.without_truth() for log in logs.values()], RIG)
    errors, sds, forces = [], [], []
    for log, of_log in zip(logs.values(), measured, strict=True):
        for one in of_log:
            true_n = log["true_wake_force_n"][one.ticks]
            errors.append(one.force_n - true_n)
            sds.append(one.force_sd_n)
            forces.append(np.abs(true_n))
    error, sd, force = np.concatenate(errors), np.concatenate(sds), np.concatenate(forces)
    assert np.sqrt(np.mean(error**2)) < 0.08  # of forces up to 2 N, from 4 mm of range noise
    assert abs(error.mean()) < 0.01
    inside = np.abs(error) < 1.645 * sd
    assert 0.80 < inside.mean() < 0.97
    assert inside[force > np.quantile(force, 0.8)].mean() > 0.75  # in the wake's core as well


@pytest.mark.whole
def test_a_sensor_whose_readings_are_old_is_measured_with_at_their_times() -> None:
    late = EffectParameter(value=0.08, unit="s")
    entry = Effect(name="range-delay", parameters={"delay_s": late})
    rig = RIG.model_copy(update={"effect": (entry,)})
    log = record(rig, seconds=20, seed=1)
    _, ((one,),) = measure([log.without_truth()], rig)
    error_m = one.smoothed.height_m - log["true_z_m"][one.ticks]
    assert np.sqrt(np.mean(error_m**2)) < 0.004
    # Whatever is left is no delay: it does not go with the speed.
    delay_s = -np.sum(error_m * one.smoothed.speed_mps) / np.sum(one.smoothed.speed_mps**2)
    assert abs(delay_s) < 0.01
    force_n = one.force_n - log["true_wake_force_n"][one.ticks]
    assert np.sqrt(np.mean(force_n**2)) < 0.12


def test_the_thrust_is_the_plants_after_spool() -> None:
    """The plant's own thrust, caught inner step by inner step."""
    seen: list[tuple[float, float]] = []
    hook = lambda t_s, state: seen.append((t_s, state["sufferer_thrust_n"])) or 0.0  # noqa: E731
    log = record(RIG, seconds=10, seed=3, force_hook=hook)
    t_s, thrust_n = np.array(seen).T
    told = thrust_after_spool(log, RIG, np.arange(t_s[0], t_s[-1], 0.001))
    told_n = np.interp(t_s, np.arange(t_s[0], t_s[-1], 0.001), told)
    flying = (t_s > 4.0) & (t_s < 12.0)
    assert np.sqrt(np.mean((told_n - thrust_n)[flying] ** 2)) < 0.06
    reported = ("applied_time_s", "sufferer_applied_us")
    without = RunLog({n: v for n, v in log.columns.items() if n not in reported}, log.metadata)
    guess = thrust_after_spool(without, RIG, np.arange(t_s[0], t_s[-1], 0.001))
    guess_n = np.interp(t_s, np.arange(t_s[0], t_s[-1], 0.001), guess)
    assert np.sqrt(np.mean((guess_n - thrust_n)[flying] ** 2)) < 0.15
    assert GantryPlant.dt_s == pytest.approx(t_s[1] - t_s[0])


@pytest.mark.whole
def test_the_set_is_what_training_takes(made: MeasuredSet) -> None:
    episodes = made.episodes
    assert episodes.domain == "gantry"
    assert [c.name for c in episodes.observation] == [
        "dx_m",
        "dz_m",
        "vx_mps",
        "vz_mps",
        "source_command",
    ]
    assert episodes.force == (Channel("force_z_n", "N"),)
    assert sorted(episodes.split.values()) == ["test", "train", "train", "validation"]
    assert all(e.extras["force_sd_n"].shape == e.force.shape for e in episodes.episodes)
    assert episodes.provenance["default_lead_s"] == default_lead_s(RIG)
    assert episodes.provenance["sources"][0]["sha256"] == "abc"
    assert 0.8 < made.r2_ceiling < 1.0


@pytest.mark.whole
def test_acceleration_and_thrust_are_kept_and_are_the_plants() -> None:
    """The carriage's own, inner step by inner step: its speed's change, and its thrust."""
    seen: list[tuple[float, float, float]] = []

    def hook(t_s: float, state: dict[str, float]) -> float:
        seen.append((t_s, state["vz_mps"], state["sufferer_thrust_n"]))
        return 0.0

    log = record(RIG, seconds=20, seed=5, force_hook=hook)
    true_s, true_mps, true_n = np.array(seen).T
    episodes = measured_set({"flight": log}, RIG).episodes.episodes
    assert len(episodes) == 4  # cut by time, extras with them
    for episode in episodes:
        t_s = episode.extras["t_s"].astype(float)
        assert episode.extras["acceleration_mps2"].shape == t_s.shape == (len(episode),)
        ahead, behind = (np.interp(t_s + h, true_s, true_mps) for h in (0.03, -0.03))
        true_mps2 = (ahead - behind) / 0.06
        error = episode.extras["acceleration_mps2"] - true_mps2
        assert np.sqrt(np.mean(error**2)) < 0.2
        assert np.std(true_mps2) > 0.5  # there was something to measure
        thrust_error = episode.extras["thrust_n"] - np.interp(t_s, true_s, true_n)
        assert np.sqrt(np.mean(thrust_error**2)) < 0.05


@pytest.mark.whole
def test_stretches_are_whole_where_a_set_would_cut_them(
    logs: dict[str, RunLog], made_of_one: MeasuredSet
) -> None:
    log = logs["flight0"]
    short = RunLog(
        {n: v[(log["t_s"] < 9.0) | (log["t_s"] > 10.5)] for n, v in log.columns.items()},
        log.metadata,
    )
    told = measured_stretches({"one": log, "two": short}, RIG)
    (whole,) = told["one"]
    assert len(told["two"]) == 2
    parts = made_of_one.episodes.episodes
    assert len(parts) == 4
    assert len(whole) == sum(map(len, parts))
    np.testing.assert_array_equal(whole.force, np.concatenate([e.force for e in parts]))


@pytest.mark.whole
def test_observations_are_those_of_the_loop(
    logs: dict[str, RunLog], made_of_one: MeasuredSet
) -> None:
    log = logs["flight0"]
    episode = made_of_one.episodes.episodes[0]
    at = np.searchsorted(log["t_s"], episode.extras["t_s"] - 1e-4)
    np.testing.assert_allclose(episode.observation[:, 0], -log["x_m"][at], atol=1e-6)
    dz_m = RIG.source.height_m - log["z_est_m"][at]
    np.testing.assert_allclose(episode.observation[:, 1], dz_m, atol=1e-6)
    np.testing.assert_allclose(episode.observation[:, 3], log["vz_est_mps"][at], atol=1e-6)


@pytest.mark.whole
def test_a_single_flight_is_split_by_time(made_of_one: MeasuredSet) -> None:
    episodes = made_of_one.episodes
    assert sorted(episodes.split.values()) == ["test", "train", "train", "validation"]
    ends = [(e.extras["t_s"][0], e.extras["t_s"][-1]) for e in episodes.episodes]
    assert all(before[1] < after[0] for before, after in itertools.pairwise(ends))


@pytest.mark.whole
def test_the_truth_changes_nothing(logs: dict[str, RunLog], made_of_one: MeasuredSet) -> None:
    blind = measured_set({"flight0": logs["flight0"].without_truth()}, RIG)
    assert blind.episodes.sha256 == made_of_one.episodes.sha256


@pytest.mark.whole
def test_a_log_with_the_required_columns_alone_can_be_smoothed(logs: dict[str, RunLog]) -> None:
    needed = {"tick", "t_s", "range_m", "range_age_s", "steps", "source_cmd_us", "sufferer_cmd_us"}
    log = logs["flight1"]
    bare = RunLog.from_rows([{n: r[n] for n in needed | {"mode"}} for r in log.rows()], {})
    made = measured_set({"bare": bare}, RIG)
    full = measured_set({"flight1": log}, RIG)
    assert "no applied pulses" in made.reports[0].note
    speed = made.episodes.episodes[0].observation[16:, 3]
    assert np.std(speed - full.episodes.episodes[0].observation[16:, 3]) < 0.06
    force = made.episodes.episodes[0].force - full.episodes.episodes[0].force
    assert np.sqrt(np.mean(force**2)) < 0.15


def test_the_rest_on_the_stop_gives_the_range_offset() -> None:
    moved = record(RIG, seconds=8, seed=0, sensor_hook=lambda t, r, steps: (r + 0.012, steps))
    assert range_offset(moved, RIG) == pytest.approx(0.012, abs=0.0015)
    plain = record(RIG, seconds=8, seed=0)
    assert range_offset(plain, RIG) == pytest.approx(0.0, abs=0.0015)


@pytest.mark.whole
def test_missing_ticks_and_samples_cut_the_flight_and_do_no_harm(logs: dict[str, RunLog]) -> None:
    log = logs["flight2"]
    kept = np.ones(len(log), dtype=bool)
    kept[320:340] = False
    holed = log.select(kept)
    holed["range_m"][200:204] = np.nan
    _, [of_log] = measure([holed], RIG)
    assert len(of_log) == 2
    for one in of_log:
        error = one.force_n - holed["true_wake_force_n"][one.ticks]
        assert np.sqrt(np.mean(error**2)) < 0.15


def test_logs_without_flight_are_refused() -> None:
    rows = [{"tick": n, "t_s": n / 32, "range_m": 0.0, "mode": "ARMED"} for n in range(99)]
    with pytest.raises(UnusableInput, match="nothing can be smoothed"):
        measured_set({"rest": RunLog.from_rows(rows, {})}, RIG)
    with pytest.raises(UnusableInput, match="no ticks"):
        measured_set({"empty": RunLog.from_rows([], {})}, RIG)


@pytest.mark.whole
def test_logs_of_another_rate_are_refused(logs: dict[str, RunLog]) -> None:
    log = logs["flight0"]
    other = RunLog(log.columns, log.metadata | {"rate_hz": "64"})
    with pytest.raises(UnusableInput, match="smooth them apart"):
        measured_set({"a": log, "b": other}, RIG)


@pytest.mark.whole
def test_training_takes_a_measured_set(made: MeasuredSet, tmp_path: Path) -> None:
    pytest.importorskip("torch")
    from click.testing import CliRunner

    from wakedeploy.cli import main

    made.episodes.write(tmp_path / "set")
    arguments = [
        "train",
        "--data",
        tmp_path / "set",
        "--arch",
        "agile-mlp",
        "--out",
        tmp_path / "r",
    ]
    done = CliRunner().invoke(main, [*map(str, arguments), "--epochs", "2"])
    assert done.exit_code == 0, done.output
    assert "ceiling" in done.output
