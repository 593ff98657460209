"""Power: what is said before flying, and the page that says it."""

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from fabricated_artefacts import leave

from runtime.loop.pilot import observation
from wakedeploy.cli.gap_plan import plan as plan_command
from wakedeploy.cli.gap_plan import power as power_command
from wakedeploy.cli.output import write_json
from wakedeploy.core.errors import UnusableInput
from wakedeploy.domains.gantry import record
from wakedeploy.gap.evidence.separation import gather, loss_nats
from wakedeploy.gap.report.power_charts import cost_chart, minutes_chart, sizes_chart
from wakedeploy.gap.report.power_page import (
    COLUMNS,
    KEPT,
    KEPT_OF,
    SURELY,
    next_step,
    rows,
    sentences,
    write_page,
)
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.systems.gantry.flight import flight_from_log
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.planning.plan import plausible_size
from wakedeploy.gap.systems.gantry.planning.power import power, step_count
from wakedeploy.gap.systems.gantry.planning.rates import Draws, fitted_share
from wakedeploy.gap.systems.gantry.planning.sensors import SENSORS, with_sensor
from wakedeploy.gap.systems.gantry.planning.tracking import (
    RigForecast,
    tracking_rmse_m,
    with_effect,
)
from wakedeploy.gap.systems.gantry.search.naming import fitted_base
from wakedeploy.physics.effects import LIBRARY
from wakedeploy.rig.file import default_rig

RIG = default_rig()
NAMES = ("battery-sag", "viscous-friction", "axial-inflow-loss")


@pytest.fixture(scope="module")
def told():
    calls: list[tuple[str, int, int]] = []
    answer = power(
        RIG,
        flights=4,
        seconds=7.5,  # a little more tells even these look-alikes apart
        names=NAMES,
        threshold_nats=4.0,
        progress=lambda *call: calls.append(call),
    )
    assert {stage for stage, done, total in calls if done == total} == {
        "flying", "tracking", "judging", "sensors", "sizes",
    }  # fmt: skip
    return answer


@pytest.fixture(scope="module")
def flown():
    return [flight_from_log(record(RIG, seconds=12, seed=s), RIG, f"{s}") for s in range(4)]


@pytest.fixture(scope="module")
def fitted(flown):
    return fitted_base(GantryModel(RIG, flown))


@pytest.mark.slow
def test_strong_effects_are_named_and_look_alikes_are_left_in_a_class(told) -> None:
    known = {e.name: e for e in told.effects}
    assert known["battery-sag"].verdict == "named"
    assert known["battery-sag"].minutes <= told.flights * told.flight_s / 60.0
    assert known["viscous-friction"].verdict == "class"
    assert known["viscous-friction"].rivals == ("axial-inflow-loss",)
    assert ("axial-inflow-loss", "viscous-friction") in told.classes
    for group, name in zip(told.classes, told.as_json()["class_sensors"], strict=True):
        rows = [told.names.index(member) for member in group]
        able = {s.name: s.euros for k, s in enumerate(SENSORS)
                if (told.named_with[rows, k + 1] >= RULES.sure_share).all()}  # fmt: skip
        assert name == min(able, key=able.__getitem__, default=None)
    for e in told.effects:
        assert e.detectable is not None
        assert e.nameable is None or e.nameable >= e.detectable


@pytest.mark.slow
def test_what_is_seen_is_known_to_be_seen(told) -> None:
    """The same flights' loss matrix, shares and sizes agree with each other."""
    for i, e in enumerate(told.effects):
        closest = np.delete(told.loss_nats[i], i).min()
        nameable = np.inf if e.nameable is None else e.nameable
        if e.named >= 0.8:  # both come from draws, so that they meet only about the edge
            assert nameable <= 1.05 * abs(e.size)
        if nameable <= 0.95 * abs(e.size):
            assert e.named >= 0.8
        if closest < 1.0:
            assert e.named < 0.5
    assert told.named_with.shape == (len(NAMES), len(SENSORS) + 1)
    assert told.threshold_nats == 4.0


@pytest.mark.slow
def test_the_page_is_whole_and_loads_nothing(told, tmp_path) -> None:
    path = write_page(told, tmp_path)
    html = path.read_text()
    assert html.count("data:image/png;base64,") == 2
    assert html.count("<svg") == 3
    assert "http://" not in html
    assert "https://" not in html
    for e in told.effects:
        assert e.name in html
    assert len(list((tmp_path / "figures").glob("power-*.png"))) == 2
    write_json(tmp_path / "power.json", told.as_json())
    read = json.loads((tmp_path / "power.json").read_text())
    assert [e["name"] for e in read["effects"]] == list(NAMES)
    assert len(read["effects"][0]) == len(told.as_json()["effects"][0])
    assert all(len(row) == len(COLUMNS) for row in rows(told))
    assert any("class" in sentence for sentence in sentences(told))


@pytest.mark.slow
def test_the_page_says_what_to_do_next(told, tmp_path) -> None:
    html = write_page(told, tmp_path, Path("rigs/mine.toml")).read_text()
    assert "Together in a class: the sufferer's thrust falls" in " ".join(sentences(told))
    assert "Next step: look for the manoeuvre that tells a class apart" in html
    words = re.sub(r"<[^>]+>", "", html)
    group = " ".join(f"--class {name}" for name in told.classes[0])
    assert f"wakedeploy gap plan --rig rigs/mine.toml {group}" in words
    alone = replace(told, effects=tuple(replace(e, rivals=()) for e in told.effects))
    why, commands = next_step(alone, None)
    assert why.startswith("Next step: fly 4 of these")
    assert commands[0] == "wakedeploy rig init rig.toml"


@pytest.mark.slow
def test_a_flight_that_an_effect_ends_and_a_size_never_named_are_said_so(told) -> None:
    never = replace(
        told.effects[0], cost_mm=None, minutes=None, flights=None, detectable=None, nameable=None
    )
    changed = replace(told, effects=(never, *told.effects[1:]))
    first = rows(changed)[0]
    assert first.count("never") == 3
    assert "fails" in first
    assert "failsafe" in " ".join(sentences(changed))
    charts = (sizes_chart(changed), cost_chart(changed), minutes_chart(changed))
    assert [chart.dots[0].note for chart in charts] == ["not seen at any size", "failsafe", "never"]


@pytest.mark.slow
def test_a_row_of_the_page_says_sizes_costs_and_minutes(told) -> None:
    for sizes, cost, minutes, each in zip(
        *(chart(told).dots for chart in (sizes_chart, cost_chart, minutes_chart)),
        told.effects,
        strict=True,
    ):
        assert sizes.low == pytest.approx(each.detectable / abs(each.size))
        assert math.isnan(sizes.value) == (each.nameable is None)
        assert f"{each.cost_mm:.1f} mm".lstrip("-") in cost.says
        assert (minutes.note == "never") == (each.minutes is None)


@pytest.mark.slow
def test_outcomes_follow_the_size(flown, fitted) -> None:
    names = ("coulomb-friction", "viscous-friction", "lost-steps")
    sizes = {n: plausible_size(RIG, n) for n in names} | {"lost-steps": (0.02,)}
    evidence = gather(*fitted, names, sizes)
    draws = Draws.of(evidence, share=fitted_share(len(flown)))
    told = draws.outcomes("lost-steps", np.array([0.025, 1.0]), 4.0)
    assert told.detected[0] < 0.3
    assert told.named[1] > 0.95
    assert np.all((told.named <= told.in_class) & (told.in_class <= told.detected))


@pytest.mark.slow
def test_each_sensor_adds_what_it_sees_and_takes_nothing_away(fitted) -> None:
    names = ("spool-lag-source", "transport-speed", "battery-sag", "range-drift")
    model, base = fitted
    evidence = gather(model, base, names, {n: plausible_size(RIG, n) for n in names})
    before = loss_nats(evidence)
    after = {s.name: loss_nats(with_sensor(evidence, model, base, s)) for s in SENSORS}
    for loss in after.values():
        assert np.all(loss >= before - 0.05 * before - 1e-3)
    lag, way, sag, drift = range(4)
    assert after["source-speed"][lag, way] > 2.0 * before[lag, way]
    assert after["second-range"][drift, sag] > 2.0 * before[drift, sag]
    assert after["battery-voltage"][lag, way] == pytest.approx(before[lag, way])


@pytest.mark.whole
def test_the_rig_files_forecast_is_the_wake_that_comes() -> None:
    """Against the plant's own wake force, a lead later, along a simulated flight without gusts."""
    calm = RIG.changed(disturbance={"turbulence_fraction": 0.0})
    log = record(calm, seconds=10.0, seed=4)
    forecast = RigForecast(calm)
    flying = np.flatnonzero(log.flying)
    columns = [log[c] for c in ("x_m", "z_est_m", "vx_mps", "vz_est_mps", "source_cmd_us")]
    forces = []
    for tick in flying:
        result = forecast.step(observation(calm, *(float(c[tick]) for c in columns)), 0.0)
        forces.append(result.force_n)
    later = np.interp(log["t_s"][flying] + forecast.lead_s, log["t_s"], log["true_wake_force_n"])
    error = np.asarray(forces) - later
    assert np.sqrt(np.mean(error**2)) < 0.25 * np.sqrt(np.mean(later**2))


@pytest.mark.whole
def test_ignoring_an_effect_costs_millimetres() -> None:
    plain = tracking_rmse_m(RIG, RIG, seconds=10.0, seed=1)
    stronger = with_effect(RIG, "wake-strength", (520.0,))
    assert 0.001 < plain < 0.02
    assert tracking_rmse_m(stronger, RIG, seconds=10.0, seed=1) > plain + 0.01


def test_every_plausible_size_can_be_flown_as_an_effect_of_a_rig() -> None:
    for name, effect in LIBRARY.items():
        entry = with_effect(RIG, name, plausible_size(RIG, name)).effect[-1]
        assert set(entry.parameters) == {p.name for p in effect.parameters}
    assert step_count(RIG, 7) == 7 + 3 * len(LIBRARY) + 1 + len(SENSORS) + 1


def test_the_share_of_promises_kept_is_the_benchmarks() -> None:
    records = Path(__file__).parents[5] / "docs" / "records"
    told = json.loads((records / "gap-power.json").read_text())
    measured = told[f"promised {SURELY:g} to 1"]
    assert (measured["cases"], round(measured["named"], 2)) == (KEPT_OF, KEPT)


def test_fewer_flights_than_confirm_an_effect_are_refused() -> None:
    for flights, words in ((1, "One flight"), (3, "Three flights")):
        with pytest.raises(UnusableInput, match=f"{words} cannot confirm .* at least 4"):
            power(RIG, flights=flights, seconds=10.0)


def test_commands_say_in_one_sentence_what_they_need(tmp_path) -> None:
    run = CliRunner()
    nothing = run.invoke(plan_command, [])
    assert "--class NAME twice" in str(nothing.exception)
    leave(tmp_path, "result", {"class": ["stiction"]})
    short = run.invoke(plan_command, ["--out", str(tmp_path)])
    assert "holds no class" in str(short.exception)
    (tmp_path / "result.json").write_text("[]")
    wrong = run.invoke(plan_command, ["--out", str(tmp_path)])
    assert "no JSON object" in str(wrong.exception)
    leave(tmp_path, "result", {"class": ["stiction", "coulomb-friction"]})
    leave(tmp_path, "find", {"rig_sha256": "ab"})
    other = run.invoke(plan_command, ["--out", str(tmp_path)])
    assert "The default rig" in str(other.exception)
    assert "give that one by --rig" in str(other.exception)
    assert "before any is flown" in run.invoke(power_command, ["--help"]).output
