"""Courses as a report draws them."""

import matplotlib as mpl
import numpy as np

from wakedeploy.gap.report.system_charts import draw_trace
from wakedeploy.gap.search.artefacts import Course, Trace

mpl.use("Agg")


def test_a_sensor_of_few_readings_has_a_line_that_breaks_where_nothing_was_logged() -> None:
    """Every second reading is missing, and a second of rows: two lines of ten readings each."""
    time_s = [*np.arange(20) * 0.1, *(3.0 + np.arange(20) * 0.1)]
    shown = [float(i) if i % 2 == 0 else float("nan") for i in range(40)]
    course = Course(unit="m", measured=shown, before=shown, after=shown)
    drawn = draw_trace(Trace(episode="log", time_s=time_s, channels={"depth_m": course}))
    assert drawn is not None
    for line in drawn.axes[0].lines:
        values = np.asarray(line.get_ydata())
        known = np.isfinite(values)
        assert known.sum() >= 19
        assert np.flatnonzero(~known).tolist() == [10]  # of what follows, one sample is left out
