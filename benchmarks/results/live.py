"""Results of live pages: what they cost the loop, and how fast a folder of flights is listed."""

from collections.abc import Mapping
from typing import Any

from benchmarks.results.section import Records, Section, paragraphs, table

RECORD = "live.json"
_QUANTILES = {"p50": "median", "p99": "p99", "p999": "p99.9", "max": "longest"}
_SERIES = {"compute_ms": "computing", "wake_up_ms": "beginning of the tick"}


def live(records: Records) -> Section:
    """What ten open pages add to the loop's latency, pair by pair."""
    result = records.json(RECORD)
    pairs, pages = result["pairs"], f"{result['pages']}"
    lines = [
        [f"{what}, {quantile}", *(_mean(pairs, count, series, key) for count in ("0", pages)),
         _added(result[f"added_{series}"][key])]
        for series, what in _SERIES.items()
        for key, quantile in _QUANTILES.items()
    ]  # fmt: skip
    listed, put_us = result["list"], result["put_us"]
    dropped = sum(pair[pages]["dropped"] for pair in pairs)
    text = (
        f"{dropped} rows were dropped. Handing a row over takes {put_us['p50']:.0f} µs of the "
        f"loop's thread. `log browse` reads {listed['logs']:,} flights in "
        f"{listed['read_s']:.0f} s, once; from then on it lists them in "
        f"{listed['from_cache_s']:.2f} s."
    )
    head = ["[ms]", "no page", f"{pages} pages", "added, mean ± standard error"]
    return Section(
        "Live pages",
        f"Flights of {result['seconds']:g} s on the virtual gantry in real time, "
        f"{len(pairs)} {'pair' if len(pairs) == 1 else 'pairs'}: one without `--live`, one with "
        f"{pages} pages open, in alternating order.",
        paragraphs(table(head, lines), text),
        (_command(result),),
    )


def _command(result: Mapping[str, Any]) -> str:
    """What makes such a record: the benchmark's own defaults may be others."""
    asked = f"--pairs {len(result['pairs'])} --seconds {result['seconds']:g}"
    asked += f" --logs {result['list']['logs']}"
    return f"python -m benchmarks.live {asked} --json docs/records/{RECORD}"


def _mean(pairs: list[Mapping[str, Any]], count: str, series: str, key: str) -> str:
    return f"{sum(pair[count][series][key] for pair in pairs) / len(pairs):.2f}"


def _added(difference: list[float | None]) -> str:
    mean, error = difference
    assert mean is not None
    return f"{mean:+.2f}" if error is None else f"{mean:+.2f} ± {error:.2f}"
