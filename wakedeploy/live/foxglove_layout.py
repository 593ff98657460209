"""How Foxglove arranges a flight, live or from a log: `foxglove-layout.json`, beside this module.

`python -m wakedeploy.live.foxglove_layout` writes it anew, by the layout classes of Foxglove's own
library. The file is all that a person needs who has that application.
"""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from foxglove.layouts import Layout, PlotPanel, StateTransitionsPanel

LAYOUT = Path(__file__).with_name("foxglove-layout.json")
_COLOURS = ("#1b6fa8", "#d1690f", "#2f8f6b", "#8a5bb0", "#6d747b")
# A panel's title, its axis, and its lines: topic.column and what the legend says.
_HEIGHT = (
    ("/height.z_ref_m", "reference"),
    ("/height.z_est_m", "estimated"),
    ("/height.range_m", "measured"),
)
_FORCE = (
    ("/force.force_pred_n", "predicted, one lead ahead"),
    ("/force.force_now_n", "measured (live only)"),
    ("/force.feedforward_n", "fed forward"),
)
_TIMING = (
    ("/timing.t_read_s", "read"),
    ("/timing.t_estimate_s", "estimate"),
    ("/timing.t_predict_s", "predict"),
    ("/timing.t_control_s", "control"),
    ("/timing.t_write_s", "write"),
)
_PULSES = (
    ("/motors.source_applied_us", "source, applied"),
    ("/motors.sufferer_cmd_us", "sufferer, commanded"),
    ("/motors.sufferer_applied_us", "sufferer, applied"),
)
_CARRIAGE = (("/carriage.x_ref_m", "reference"), ("/carriage.x_m", "carriage"))
_ROUND_TRIP = (("/timing.round_trip_s", "command to answer"),)
_BATTERY = (("/motors.battery_v", "battery"),)


def layout() -> "Layout":
    """Height and force large, what the computer and the rig do beside, modes and faults below."""
    from foxglove.layouts import Layout, SplitContainer, SplitItem

    left_column = SplitContainer(
        direction="column",
        items=[
            SplitItem(proportion=3, content=_plot("Height", "m", _HEIGHT)),
            SplitItem(proportion=3, content=_plot("Force on the sufferer", "N", _FORCE)),
            SplitItem(proportion=1.4, content=_states()),
        ],
    )
    right_column = SplitContainer(
        direction="column",
        items=[
            SplitItem(content=_plot("Time of each stage", "s", _TIMING)),
            SplitItem(content=_plot("Round trip", "s", _ROUND_TRIP)),
            SplitItem(content=_plot("Pulses", "µs", _PULSES)),
            SplitItem(content=_plot("Carriage", "m", _CARRIAGE)),
            SplitItem(content=_plot("Battery", "V", _BATTERY)),
        ],
    )
    items = [
        SplitItem(proportion=2, content=left_column),
        SplitItem(proportion=1, content=right_column),
    ]
    return Layout(content=SplitContainer(direction="row", items=items))


def _plot(title: str, unit: str, lines: tuple[tuple[str, str], ...]) -> "PlotPanel":
    from foxglove.layouts import PlotConfig, PlotPanel, PlotSeries

    series = [
        PlotSeries(value=path, label=label, color=colour, timestamp_method="receiveTime")
        for (path, label), colour in zip(lines, _COLOURS, strict=False)
    ]
    config = PlotConfig(
        paths=series, y_axis_label=unit, legend_display="floating", is_synced=True,
        show_legend=True, x_axis_val="timestamp", following_view_width=30.0,
    )  # fmt: skip
    return PlotPanel(title=title, config=config)


def _states() -> "StateTransitionsPanel":
    from foxglove.layouts import (
        StateTransitionsConfig,
        StateTransitionsPanel,
        StateTransitionsSeries,
    )

    shown = (("/state.mode", "mode"), ("/state.faults", "faults"))
    series = [
        StateTransitionsSeries(value=path, label=label, timestamp_method="receiveTime")
        for path, label in shown
    ]
    config = StateTransitionsConfig(paths=series, is_synced=True, x_axis_range=30.0)
    return StateTransitionsPanel(title="Modes and faults", config=config)


def layout_text() -> str:
    """The file's content."""
    import json

    return json.dumps(json.loads(layout().to_json()), indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    LAYOUT.write_text(layout_text(), "utf-8")
