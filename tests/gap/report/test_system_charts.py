"""Courses as a report draws them."""

import matplotlib as mpl
import numpy as np
import pytest

from wakedeploy.gap.report.system_charts import draw_trace
from wakedeploy.gap.search.artefacts import Course, Trace

mpl.use("Agg")


@pytest.mark.parametrize("is_silent", [True, False])
def test_a_sensor_of_few_readings_has_a_line_that_breaks_where_none_came(is_silent) -> None:
    """Every second row has a reading, and for a second none has, or no row is logged."""
    rows_s = np.arange(0.0, 4.95, 0.1)
    in_hole = (rows_s > 1.95) & (rows_s < 2.95)
    if not is_silent:
        rows_s, in_hole = rows_s[~in_hole], in_hole[~in_hole]
    shown = np.where(np.round(rows_s / 0.1) % 2 == 0, rows_s**2, np.nan)
    shown[in_hole] = np.nan
    course = Course(unit="m", measured=[*shown], before=[*shown], after=[*shown])
    drawn = draw_trace(Trace(episode="log", time_s=[*rows_s], channels={"depth_m": course}))
    assert drawn is not None
    for line in drawn.axes[0].lines:
        at_s, values = np.asarray(line.get_xdata()), np.asarray(line.get_ydata())
        known = np.isfinite(values)
        assert at_s[known] == pytest.approx(rows_s[np.isfinite(shown)])
        assert values[known] == pytest.approx(at_s[known] ** 2)
        assert np.flatnonzero(~known).tolist() == [10]  # after the ten readings up to 1.8 s
