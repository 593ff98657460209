"""The picture of a run: what ended it, and axes that leave noise small."""

import math

import numpy as np
import pytest

from wakedeploy.core.failsafes import HINTS
from wakedeploy.core.run_figure import draw_run
from wakedeploy.core.run_summary import summarise
from wakedeploy.core.runlog import RunLog
from wakedeploy.domains.gantry import record


@pytest.fixture(scope="module")
def blinded() -> RunLog:
    """A flight whose range sensor falls silent after 5 s."""
    return record(
        None, seconds=7, seed=3, sensor_hook=lambda t, r, n: (r if t < 5 else math.nan, n)
    )


def pictured(log: RunLog):
    return draw_run(log, summarise(log), "flight.mcap")


def texts(drawn) -> list[str]:
    return [text.get_text() for panel in drawn.axes for text in panel.texts]


def test_a_failsafe_is_marked_in_every_panel_with_its_cause_in_words(blinded: RunLog) -> None:
    drawn = pictured(blinded)
    at_s = blinded["t_s"][list(blinded["mode"]).index("FAILSAFE")]
    for panel in drawn.axes[:5]:
        upright = [line for line in panel.lines if set(line.get_xdata()) == {at_s}]
        assert len(upright) == 1, panel.get_title(loc="left")
    said = f"{at_s:.2f} s: no new range sample"
    assert said in texts(drawn)
    assert drawn.get_suptitle().endswith(f"\nFailsafe at {said}")
    assert HINTS["sensor_lost"].startswith("no new range sample")


def test_a_flight_that_ended_well_has_no_mark(blinded: RunLog) -> None:
    well = blinded.select(blinded["mode"] != "FAILSAFE")
    drawn = pictured(well)
    assert "Failsafe" not in drawn.get_suptitle()
    assert not [line for line in drawn.axes[0].lines if len(set(line.get_xdata())) == 1]


def test_the_cause_stays_in_the_picture_whenever_the_flight_ends(blinded: RunLog) -> None:
    for cut in (slice(None), slice(blinded["mode"].tolist().index("FAILSAFE") - 3, None)):
        drawn = pictured(blinded.select(cut))
        drawn.canvas.draw()
        (told,) = [t for t in drawn.axes[0].texts if "no new" in t.get_text()]
        inside, box = drawn.axes[0].get_window_extent(), told.get_window_extent()
        assert inside.x0 <= box.x0 < box.x1 <= inside.x1


def test_a_failsafe_without_or_of_an_unknown_fault_is_told_so(blinded: RunLog) -> None:
    for fault, words in (("", "no cause recorded"), ("belt_torn", "belt torn")):
        blinded_by = blinded.select(slice(None))
        blinded_by.columns["faults"] = np.array([fault] * len(blinded), dtype=object)
        assert pictured(blinded_by).get_suptitle().endswith(words)


def test_noise_at_rest_does_not_fill_the_axes(blinded: RunLog) -> None:
    resting = blinded.select(blinded["mode"] == "ARMED")
    assert 0 < np.ptp(resting["x_m"]) < 0.001
    panels = pictured(resting).axes
    height, error, force, commands, timing, carriage = panels
    assert np.ptp(height.get_ylim()) > 0.1
    assert np.ptp(force.get_ylim()) >= 0.1
    assert np.ptp(commands.get_ylim()) >= 100
    assert np.ptp(carriage.get_ylim()) >= 0.02
    low_ms, high_ms = timing.get_ylim()
    assert low_ms <= 1.0
    assert high_ms > 1e3 / resting.rate_hz
    assert [text.get_text() for text in error.texts] == ["never flown"]


def test_a_steady_flight_spans_20_mm_of_error(blinded: RunLog) -> None:
    steady = blinded.select(blinded.flying).without_truth()
    steady.columns["z_est_m"] = steady["z_ref_m"] + 1e-4 * np.sin(steady["t_s"])
    error, force = pictured(steady).axes[1:3]
    low_mm, high_mm = error.get_ylim()
    assert high_mm - low_mm >= 20
    assert abs(high_mm + low_mm) < 0.1
    assert [text.get_text() for text in force.texts] == ["not recorded"]


def test_a_short_landing_is_named_and_untimed_computing_said() -> None:
    log = record(None, seconds=7, seed=3)
    log.metadata["simulated"] = "true"
    panels = pictured(log).axes
    assert "LANDING" in [text.get_text() for text in panels[0].texts]
    timing = panels[4].get_title(loc="left")
    assert timing == "Round trip (computing: not measured in simulated time)"
