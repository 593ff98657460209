"""Logs as the gap workflow reads them, against the plant that flew them, and what it refuses."""

import re
from pathlib import Path

import numpy as np
import pytest
from recorded import QUIET, RIG, SECONDS, changed, probed

from runtime.simulated import COMPUTE_S
from runtime.virtual.mcu import Mcu
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.runlog import RunLog
from wakedeploy.core.runlog_columns import COLUMNS, FLYING
from wakedeploy.domains.gantry import record
from wakedeploy.gap.systems.gantry.flight import (
    AIRBORNE_M,
    DT_S,
    SETTLING_S,
    Flight,
    flight_from_log,
    placed,
    read_flights,
)
from wakedeploy.gap.systems.gantry.likelihood import GantryModel

FIELDS = [name for name in Flight.__dataclass_fields__ if name not in ("name", "sha256")]


@pytest.fixture(scope="module")
def quiet():
    """A flight without noise, and what truly happened."""
    log, probe = probed()
    return flight_from_log(log.without_truth(), QUIET, "quiet"), log, probe


@pytest.fixture(scope="module")
def log() -> RunLog:
    """An ordinary noisy flight."""
    return record(RIG, seconds=SECONDS, seed=12)


def airborne(flight: Flight) -> np.ndarray:
    """Indices of the steps in the air."""
    return np.concatenate([np.arange(a, b) for a, b in zip(flight.start, flight.stop, strict=True)])


def same(one: Flight, other: Flight) -> bool:
    """Whether two flights are equal in every byte."""
    for name in FIELDS:
        a, b = getattr(one, name), getattr(other, name)
        if name in ("source", "sufferer"):
            if a.t_s.tobytes() != b.t_s.tobytes() or a.value.tobytes() != b.value.tobytes():
                return False
        elif isinstance(a, np.ndarray):
            if a.tobytes() != b.tobytes():
                return False
        elif a != b:
            return False
    return True


@pytest.mark.parametrize("motor", ["source", "sufferer"])
def test_the_mcus_output_is_what_the_mcu_gives_when_it_is_stepped(log, motor: str) -> None:
    t_s, dt_s = log["t_s"], 1.0 / 4096
    arrivals_s = t_s + COMPUTE_S + 0.5 * RIG.latency.round_trip_s
    mcu = Mcu(RIG)
    mcu.arm(float(arrivals_s[0]))
    flying = np.flatnonzero(np.isin(log["mode"], FLYING))
    times, outputs, tick = [], [], 0
    for now in np.arange(arrivals_s[0], arrivals_s[flying[-1]], dt_s):
        while arrivals_s[tick] <= now:
            commands = [float(log[f"{m}_cmd_us"][tick]) for m in ("source", "sufferer")]
            mcu.command(float(now), *commands, 0.0, 1000.0, 1000.0)
            tick += 1
        out = mcu.advance(float(now), dt_s)
        times.append(now + dt_s)  # what the pins do at the step's end
        outputs.append(getattr(out, f"{motor}_us"))
    line = getattr(flight_from_log(log, RIG, "log"), motor).at(np.array(times))
    # A step of the emulation moves the pulse by 5 µs where it slews.
    assert np.abs(line - outputs).max() < 3 * RIG.limits.slew_us_per_s * dt_s
    assert np.ptp(outputs) > 200.0


def test_readings_are_placed_at_the_times_when_they_were_taken(quiet) -> None:
    """Without noise a reading is the true height at that time, to the sensor's millimetre."""
    flight, _, probe = quiet
    truth = np.interp(flight.sample_s, probe["t_s"], probe["z_m"])
    assert np.abs(flight.reading_m - truth).max() < 0.6e-3 + 1e-3
    step, into_s = placed(flight.grid_s, flight.sample_s)
    assert (into_s >= -1e-9).all()
    assert (into_s < DT_S).all()
    assert flight.grid_s[step] + into_s == pytest.approx(flight.sample_s)


def test_the_first_look_at_the_motion_is_near_the_truth(quiet) -> None:
    flight, _, probe = quiet
    at = airborne(flight)
    height, speed = (np.interp(flight.grid_s, probe["t_s"], probe[n]) for n in ("z_m", "vz_mps"))
    assert np.sqrt(np.mean((flight.nominal[0] - height)[at] ** 2)) < 0.002
    assert np.sqrt(np.mean((flight.nominal[1] - speed)[at] ** 2)) < 0.05


def test_the_carriage_is_where_it_is(quiet) -> None:
    flight, _, probe = quiet
    middle_s = flight.grid_s + 0.5 * DT_S
    x_m, vx_mps = (np.interp(middle_s, probe["t_s"], probe[n]) for n in ("x_m", "vx_mps"))
    at = airborne(flight)
    assert np.ptp(x_m) > 0.2
    assert np.abs(flight.x_m - x_m)[at].max() < 0.004
    assert np.sqrt(np.mean((flight.vx_mps - vx_mps)[at] ** 2)) < 0.02


def test_frames_begin_when_pulses_are_applied(quiet) -> None:
    flight, log, _ = quiet
    frame_s = QUIET.disturbance.esc_frame_s
    assert np.diff(flight.frame_s) == pytest.approx(frame_s)
    applied = log["applied_time_s"][np.isfinite(log["applied_time_s"])]
    applied = applied[applied > flight.frame_s[0]]
    late = (applied - flight.frame_s[0] + 0.5 * frame_s) % frame_s - 0.5 * frame_s
    assert np.abs(late).max() < 0.005  # the plant looks every 4 ms
    assert flight.frame_s[0] <= flight.grid_s[0]
    assert flight.frame_s[-1] >= flight.grid_s[-1] - frame_s


def test_stretches_are_in_the_air_and_samples_count_after_settling(quiet) -> None:
    flight, _, probe = quiet
    truth = np.interp(flight.grid_s[airborne(flight)], probe["t_s"], probe["z_m"])
    assert truth.min() > AIRBORNE_M - 0.01
    assert flight.airborne_s == pytest.approx(len(truth) * DT_S)
    assert flight.airborne_s > 0.6 * SECONDS
    counted_s = flight.sample_s[flight.counted]
    assert counted_s.min() > flight.grid_s[flight.start[0]] + SETTLING_S
    assert counted_s.max() < flight.grid_s[flight.stop[-1] - 1]
    # The sensor samples every 20 ms, the loop reads every 31.25 ms: each or every second one.
    assert 0.018 < flight.spacing_s < 0.042


@pytest.mark.parametrize(
    ("bias_m", "tolerance_m"), [(-0.003, 0.001), (0.0, 5e-4), (0.004, 5e-4), (0.02, 3e-4)]
)
def test_means_at_rest_are_unbiased_though_no_range_is_negative(log, bias_m, tolerance_m) -> None:
    """At rest on the stop the sensor cuts off half of its noise; the mean is that of all of it."""
    rng = np.random.default_rng(3)
    rest = ~np.isin(log["mode"], (*FLYING, "LANDING"))
    away, deviations = [], []
    for _ in range(25):
        true_m = bias_m + 0.004 * rng.standard_normal(len(rest))
        read_m = np.maximum(0.0, np.round(true_m, 3))
        range_m = np.where(rest, read_m, log["range_m"])
        found = flight_from_log(changed(log, range_m=range_m), RIG, "at rest").rest
        assert found.shape == (2, 4)
        away += (found[:, 0] - bias_m).tolist()
        deviations += np.sqrt(found[:, 1]).tolist()
    assert abs(np.mean(away)) < tolerance_m
    if bias_m <= 0.0:
        cut_off = np.maximum(0.0, bias_m + 0.004 * rng.standard_normal(10**5)).mean()
        assert cut_off - bias_m > 3 * tolerance_m
    assert np.std(away) < np.mean(deviations)  # which have the sensor's own zero in them


@pytest.mark.parametrize("bias_m", [-0.006, -0.008, -0.02])
def test_rests_that_read_zero_are_a_ceiling_for_the_mean(log, bias_m) -> None:
    rng = np.random.default_rng(4)
    rest = ~np.isin(log["mode"], FLYING)
    read_m = np.maximum(0.0, np.round(bias_m + 0.004 * rng.standard_normal(len(rest)), 3))
    cut_off = changed(log, range_m=np.where(rest, read_m, log["range_m"]))
    flight = flight_from_log(cut_off, RIG, "x")
    assert flight.rest[:, 3].all()
    model = GantryModel(RIG, [flight])
    theta = model.start(())
    place = [f.name for f in model.free(())].index("range.bias_m")

    def nats(bias_m: float) -> float:
        theta[place] = bias_m
        rests = slice(-3, -1)  # what stands before the repeats
        return float(model.score((), theta, 0).log_density[rests].sum())

    assert nats(bias_m) > nats(-0.03) - 0.5  # the truth is as likely as anything below
    assert nats(0.0) < nats(bias_m) - 2.0
    assert nats(0.02) < nats(bias_m) - 20.0


def test_a_sensor_that_reads_one_other_value_at_rest_may_be_stuck(log) -> None:
    rest = ~np.isin(log["mode"], FLYING)
    flight = flight_from_log(changed(log, range_m=np.where(rest, 0.03, log["range_m"])), RIG, "x")
    assert flight.rest.shape == (0, 4)


def test_truth_in_a_log_makes_no_difference(log, tmp_path) -> None:
    """Not in one byte, not even if it is nonsense."""
    nonsense = {n: np.full(len(log), 1e6) for n in log.columns if n.startswith("true_")}
    assert len(nonsense) == 3
    flights = []
    for name, each in (("a", log), ("b", log.without_truth()), ("c", changed(log, **nonsense))):
        each.write_mcap(tmp_path / f"{name}.mcap")
        flights += read_flights([tmp_path / f"{name}.mcap"], RIG)
    assert same(flights[0], flights[1])
    assert same(flights[0], flights[2])


def test_csv_and_mcap_are_the_same_flight(log, tmp_path) -> None:
    log.write_mcap(tmp_path / "a.mcap")
    log.write_csv(tmp_path / "a.csv")
    one, other = read_flights([tmp_path / "a.mcap", tmp_path / "a.csv"], RIG)
    assert same(one, other)
    assert one.sha256 != other.sha256


def test_a_log_with_the_columns_of_the_documentation_alone_is_the_same_flight(
    log, tmp_path
) -> None:
    page = (Path(__file__).parents[4] / "docs" / "reference" / "run-log.md").read_text(
        encoding="utf-8"
    )
    table = page.partition("## Logs of another loop")[2]
    rows = re.findall(r"^\| (`.*?) \|", table, re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`(\w+)`", row)}
    assert named > {c.name for c in COLUMNS if c.presence == "required"}
    told = {name: values for name, values in log.columns.items() if name in named}
    path = tmp_path / "a.csv"
    RunLog(told, dict(log.metadata)).write_csv(path)
    (flight,) = read_flights([path], RIG)
    whole = changed(log, x_ref_m=np.full(len(log), np.nan)).without_truth()
    assert same(flight, flight_from_log(whole, RIG, "a"))


@pytest.mark.whole
def test_flights_keep_the_order_in_which_they_are_given(log, tmp_path) -> None:
    paths = [tmp_path / "z.mcap", tmp_path / "a.mcap"]
    record(RIG, seconds=9, seed=3).write_mcap(paths[0])
    log.write_mcap(paths[1])
    assert [f.name for f in read_flights(paths, RIG)] == [str(p) for p in paths]


def refusal(log: RunLog, name: str = "flight.mcap") -> str:
    """Why a log is refused: one sentence with the log's name."""
    with pytest.raises(UnusableInput) as refused:
        flight_from_log(log, RIG, name)
    return sentence(refused, name)


def sentence(refused, name: str) -> str:
    text = str(refused.value)
    assert name in text
    assert text.endswith(".")
    assert "\n" not in text
    assert "nan" not in text.lower().split()
    return text


def test_a_short_flight_is_refused() -> None:
    assert "in the air" in refusal(record(RIG, seconds=5, seed=1))


def test_a_log_of_a_few_ticks_is_refused(log) -> None:
    assert "20 ticks" in refusal(log.select(slice(0, 20)))


def test_a_log_that_never_flew_is_refused(log) -> None:
    grounded = np.array(["ARMED"] * len(log), dtype=object)
    assert "never flew" in refusal(changed(log, mode=grounded))


def test_a_broken_sensor_is_refused(log) -> None:
    assert "range_m is constant" in refusal(changed(log, range_m=np.full(len(log), 0.5)))
    assert "0 fresh range samples" in refusal(changed(log, range_m=np.full(len(log), np.nan)))


def test_a_constant_command_is_refused(log) -> None:
    still = changed(log, sufferer_cmd_us=np.full(len(log), 1700.0))
    assert "sufferer_cmd_us is constant" in refusal(still)


@pytest.mark.parametrize(
    ("column", "wrong", "says"),
    [
        ("sufferer_cmd_us", lambda v: (v - 1000.0) / 1000.0, "has to be in microseconds"),
        ("source_cmd_us", lambda v: v + 1100.0, "source_cmd_us lies between 2"),
        ("range_m", lambda v: 1000.0 * v, "range_m is 6?[0-9]+.* has to be in metres"),
        ("range_m", lambda v: 100.0 * v, "has to be in metres"),
        ("range_age_s", lambda v: -v - 0.01, "how long before t_s"),
        ("range_age_s", lambda v: v + 1.0, "how long before t_s"),
        ("range_age_s", lambda v: 1000.0 * v, "in seconds"),
        ("steps", lambda v: v + 1e5 * (np.arange(len(v)) == len(v) // 2), "without jumps"),
        ("steps", lambda v: v + 1e4, "has to be 0 at x = 0"),
    ],
)
def test_a_column_in_another_unit_or_from_another_origin_is_refused(
    log, column: str, wrong, says: str
) -> None:
    assert re.search(says, refusal(changed(log, **{column: wrong(log[column])})))


def test_what_lies_a_little_beyond_or_is_cut_off_is_said(log) -> None:
    beyond = log["source_cmd_us"].copy()
    beyond[len(log) // 2 :][:40] = 2100.0
    torn = RunLog({**log.columns, "source_cmd_us": beyond},
                  {**log.metadata, "unfinished": "The log is unfinished."})  # fmt: skip
    notes = flight_from_log(torn, RIG, "x").notes
    assert "The log is unfinished." in notes
    assert any("of source_cmd_us lie beyond limits.pulse_us" in note for note in notes)


def test_a_clock_that_jumps_is_refused_and_a_short_gap_is_noted(log) -> None:
    middle = len(log) // 2
    jumped = log["t_s"] + np.where(np.arange(len(log)) >= middle, 3.0, 0.0)
    assert "clock jumps by 3.0" in refusal(changed(log, t_s=jumped))
    bridged = flight_from_log(log.select(np.abs(np.arange(len(log)) - middle) > 3), RIG, "x")
    assert len(bridged.notes) == 1
    assert "gap" in bridged.notes[0]
    assert flight_from_log(log, RIG, "x").notes == ()


def test_what_had_to_be_assumed_of_a_log_is_said(log) -> None:
    blind = RunLog(
        {**log.columns, "applied_time_s": np.full(len(log), np.nan),
         "steps": np.full(len(log), 120.0), "source_cmd_us": np.full(len(log), 1000.0)},
        {k: v for k, v in log.metadata.items() if not k.startswith("rig_")},
    )  # fmt: skip
    notes = " ".join(flight_from_log(blind, RIG, "x").notes)
    for word in ("servo frame", "rig file", "carriage stands still", "source is off"):
        assert word in notes


def test_another_rig_is_refused_and_another_effect_is_not(log, tmp_path) -> None:
    path = tmp_path / "a.mcap"
    log.write_mcap(path)
    other = RIG.changed(
        thrust={"sufferer": {"thrust_n": [1.1 * n for n in RIG.thrust.sufferer.thrust_n]}}
    )
    with pytest.raises(UnusableInput) as refused:
        read_flights([path], other)
    assert "[thrust]" in sentence(refused, str(path))
    corrected = RIG.changed(spool={"sufferer": {"up_s": 0.09}}, wake={"speed_mps": 5.0})
    assert len(read_flights([path], corrected)) == 1


def test_a_rig_that_the_log_only_names_is_refused(log, tmp_path) -> None:
    metadata = {k: v for k, v in log.metadata.items() if k != "rig_toml"}
    RunLog(log.columns, metadata | {"rig_sha256": "0" * 64}).write_mcap(tmp_path / "a.mcap")
    with pytest.raises(UnusableInput) as refused:
        read_flights([tmp_path / "a.mcap"], RIG)
    assert "another rig file" in sentence(refused, "a.mcap")


def test_the_same_recording_twice_is_refused(log, tmp_path) -> None:
    for name in ("a", "b"):
        log.write_mcap(tmp_path / f"{name}.mcap")
    with pytest.raises(UnusableInput) as refused:
        read_flights([tmp_path / "a.mcap", tmp_path / "b.mcap"], RIG)
    assert "more than once" in sentence(refused, "a.mcap")


@pytest.mark.parametrize("column", ["t_s", "range_m", "steps", "sufferer_cmd_us", "mode"])
def test_a_log_without_a_column_is_refused(log, tmp_path, column: str) -> None:
    path = tmp_path / "a.csv"
    log.write_csv(path)
    rows = [line.split(",") for line in path.read_text("utf-8").splitlines()]
    at = rows[0].index(column)
    path.write_text("\n".join(",".join(r[:at] + r[at + 1 :]) for r in rows), "utf-8")
    with pytest.raises(UnusableInput) as refused:
        read_flights([path], RIG)
    assert column in sentence(refused, "a.csv")


def test_no_logs_are_refused() -> None:
    with pytest.raises(UnusableInput) as refused:
        read_flights([], RIG)
    sentence(refused, "--measured")


def test_commands_are_held_where_they_were_not_logged(log) -> None:
    commands = log["sufferer_cmd_us"].copy()
    commands[200:203] = np.nan
    held = flight_from_log(changed(log, sufferer_cmd_us=commands), RIG, "x")
    assert np.isfinite(held.sufferer.at(held.grid_s)).all()
