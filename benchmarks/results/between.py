"""Results of what an input does between samples, on two fast systems."""

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.results.section import Records, Section, paragraphs, table

RECORD = "between-samples.json"
Row = Mapping[str, Any]


def compared(records: Records) -> Section:
    """Forecast errors by how the input is held and in how many steps the model goes."""
    record = records.json(RECORD)
    rows: Sequence[Row] = record["rows"]
    return Section(
        "What an input does between samples",
        "Two systems with what the literature names built in: the input kept from sample to "
        "sample, straight to the next, or band-limited.",
        paragraphs(
            "Root mean square of measured less forecast on sealed blocks, and the noise of the "
            "sensor as fitted.",
            table(
                ["recording", "input", "steps in a sample", "forecast over", "error", "noise"],
                [
                    [row["recording"], row["hold"], str(row["steps"]),
                     f"{row['forecast_s']:.3g} s", f"{row['rms']:.3g} {row['unit']}",
                     f"{row['noise']:.2g} {row['unit']}"]
                    for row in rows
                ],
            ),
            "The Bouc–Wen oscillator is simulated, so its constants are known:",
            _constants(rows, record["truth"]),
        ),
        (f"python -m benchmarks.real_systems.between --json docs/records/{RECORD}",),
    )  # fmt: skip


def _constants(rows: Sequence[Row], truth: Mapping[str, float]) -> str:
    known = [row for row in rows if set(truth) <= set(row["constants"])]
    return table(
        ["input, steps", *truth],
        [
            ["true", *(f"{value:.4g}" for value in truth.values())],
            *(
                [f"{row['hold']}, {row['steps']}",
                 *(f"{row['constants'][name]:.4g}" for name in truth)]
                for row in known
            ),
        ],
    )  # fmt: skip
