"""ESC logs: what is read of them, and the spool lag in logs made here and recorded elsewhere."""

import datetime
import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from wakedeploy.cli.gap_domain import domain
from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.motor import read_steps
from wakedeploy.gap.evidence.inference import fit, settled
from wakedeploy.gap.evidence.ranking import rank
from wakedeploy.gap.search.outcome import UNSEEN_WORSE
from wakedeploy.gap.systems.domains.motor import MotorModel, step_response
from wakedeploy.gap.workflow import concluded

DUTIES = (20, 30, 40, 50, 60, 40, 20, 45, 25)


def written(folder: Path, up_s: float, down_s: float, seed: int = 0) -> Path:
    """A log as the ESC writes it: bursts 60 times a second, each step every two seconds."""
    rng = np.random.default_rng(seed)
    fine_s, rpm, speeds = 0.001, 150.0 * DUTIES[0], []
    commands = np.repeat(DUTIES, 2000)
    for command in commands:
        tau_s = max(up_s if 150.0 * command > rpm else down_s, 1e-9)
        rpm += (150.0 * command - rpm) * (1.0 - np.exp(-fine_s / tau_s))
        speeds.append(rpm)
    begin = datetime.datetime(2020, 1, 1)
    lines = ["Timestamp,Batt. Volts,RPM,Duty"]
    for at in np.arange(20, len(commands), 1000 / 60).astype(int):
        stamp = begin + datetime.timedelta(milliseconds=int(at))
        stamp_text = f"{stamp:%Y-%m-%d %H:%M:%S}:{stamp.microsecond // 1000:03d}"
        lines.append(f"{stamp_text},16,{speeds[at] + rng.normal(0, 20):.1f},{commands[at]}")
    (folder / "made.csv").write_text("\n".join(lines) + "\n")
    return folder


def test_every_step_between_running_duties_is_read(tmp_path):
    steps = read_steps(written(tmp_path, 0.04, 0.08))
    assert [(s.before, s.after) for s in steps] == list(itertools.pairwise(DUTIES))
    assert all(s.time_s[0] < s.step_s < s.time_s[-1] for s in steps)


@pytest.mark.whole
def test_a_hidden_lag_is_named_with_both_time_constants(tmp_path):
    model = MotorModel(read_steps(written(tmp_path, 0.04, 0.08)))
    base = fit(model, (), range(model.episodes))
    ranking = rank(model, base, ("spool-lag", "command-latency", "warming"))
    assert ranking[0].name == "spool-lag"
    assert ranking[0].gain_nats > ranking[1].gain_nats + 20
    found, _ = settled(model, ranking[0].fit)
    assert found.value("spool-lag.tau_up_s") == pytest.approx(0.04, abs=0.006)
    assert found.value("spool-lag.tau_down_s") == pytest.approx(0.08, abs=0.008)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("Timestamp,RPM\n", "holds 0 usable steps"),
        ("Timestamp,RPM,Duty\n2020-01-01 00:00:00:000,1,2\n", "'Batt. Volts' is missing"),
        ("Timestamp,RPM,Duty,Batt. Volts\nyesterday,1,2,3\n", "damaged"),
    ],
)
def test_logs_that_cannot_be_used_say_why(tmp_path, content, says):
    (tmp_path / "bad.csv").write_text(content)
    with pytest.raises(UnusableInput, match=says):
        read_steps(tmp_path)


@pytest.mark.slow
def test_the_command_names_and_writes(tmp_path):
    logs = tmp_path / "logs"
    logs.mkdir()
    written(logs, 0.04, 0.08)
    arguments = ["motor", str(logs), "--out", str(tmp_path / "out")]
    result = CliRunner().invoke(domain, arguments, catch_exceptions=False)
    assert "named: spool-lag" in result.output
    told = json.loads((tmp_path / "out" / "domain.json").read_text())
    assert [e["name"] for e in told["effects"]] == ["spool-lag"]
    assert told["single_steps"]["down"]["median_s"] == pytest.approx(0.08, abs=0.008)
    page = (tmp_path / "out" / "report.html").read_text()
    assert "The baseline lacks <code>spool-lag</code>." in page
    assert "exponential fitted to each step alone" in page
    drawn = {p.stem for p in (tmp_path / "out" / "figures").iterdir()}
    assert drawn == {"places", "gap", "trace", "autocorrelation"}
    assert page.count("<img") == len(drawn) - 1
    rounds = len(told["rounds"])
    assert page.count("<svg") == rounds + 1  # rankings, and the trace: their points say values


@pytest.mark.whole
def test_recorded_motors_spool_as_single_steps_say(recordings):
    steps = read_steps(recordings("motor"))
    chosen = [*steps[:6], *(s for s in steps if s.after < s.before)]
    model = MotorModel(tuple(chosen))
    base = fit(model, (), range(model.episodes))
    best = rank(model, base, ("command-latency", "spool-lag", "battery-sag"))[0]
    assert best.name == "spool-lag"
    for name, rising in (("up", True), ("down", False)):
        alone = np.median([step_response(s) for s in chosen if (s.after > s.before) == rising])
        assert best.fit.value(f"spool-lag.tau_{name}_s") == pytest.approx(alone, rel=0.25)


@pytest.mark.slow
def test_an_effect_that_sealed_steps_speak_against_is_not_named(recordings):
    result = concluded(MotorModel(read_steps(recordings("motor"))))
    assert [e.name for e in result.effects] == ["spool-lag"]
    beside = result.rounds[1]
    best = beside.ranking[0]
    assert best.name == "slew-limit"
    assert best.gain_nats > beside.threshold_nats
    assert best.judged == UNSEEN_WORSE
