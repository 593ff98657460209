"""The page of a benchmark: its verdict in words, what to do next, and every figure in it."""

import html
import re
from pathlib import Path

import pytest

from runtime.bench import BenchRow
from wakedeploy.cli.bench_page import write_bench_page

SPREAD = {"p50": 0.1, "p99": 0.2, "p999": 0.3, "max": 0.4}


def row(arch: str, **changed) -> BenchRow:
    figures = {"ticks": 3200, "p50_ms": 0.5, "p99_ms": 1.0, "p999_ms": 1.5, "max_ms": 2.0}
    figures |= {"cpu_percent": 3.0, "rss_mb": 140.0, "first_call_ms": 9.0, "overruns": 0}
    return BenchRow(arch, realtime=True, stages_ms={"t_read_s": SPREAD}, **figures | changed)


def page(tmp_path: Path, *rows: BenchRow, files=()) -> str:
    path = tmp_path / "latency.html"
    write_bench_page(path, rows, 10.0, files)
    words = re.sub(r"</?span>", "", path.read_text("utf-8"))  # about each word of a command
    return html.unescape(words)


@pytest.mark.parametrize(
    ("changed", "verdict", "command"),
    [
        ({}, "Yes: gru, the slowest, took 1.50 ms", "wakedeploy bench latency gru.onnx --busy"),
        ({"p999_ms": 11.0}, "No: gru took longer than the 10.00 ms", "wakedeploy doctor"),
        ({"ticks": 64}, "That is preliminary", "wakedeploy bench latency gru.onnx</code>"),
    ],
)
def test_the_verdict_is_a_sentence_and_a_command_follows(
    changed, verdict, command, tmp_path: Path
) -> None:
    text = page(tmp_path, row("gru", **changed), files=[Path("gru.onnx")])
    assert verdict in text
    assert command in text


def test_times_lie_where_their_logarithm_says(tmp_path: Path) -> None:
    text = page(tmp_path, row("gru"), row("tcn", p50_ms=1.0, max_ms=8.0))
    marks = re.findall(r'cx="([\d.]+)"[^>]*><title>([^<]+)</title>', text)
    at = {said: float(x) for x, said in marks}
    octave = at["gru, p99: 1.00 ms"] - at["gru, median: 0.50 ms"]
    assert at["tcn, longest: 8.00 ms"] - at["tcn, median: 1.00 ms"] == pytest.approx(
        3 * octave, abs=1
    )
