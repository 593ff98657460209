"""The latency table: all eight architectures in the real loop, with and without real time.

Each row is a process of its own, paced at 32 Hz over the virtual gantry's port while every other
core is kept busy, and timed from measurement received to command written.

    python -m benchmarks.latency --json docs/records/latency.json
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from benchmarks import records

TICKS = 4096
MACHINE_SETTINGS = {
    "busy, --realtime": ("--busy", "--realtime"),
    "busy": ("--busy", "--no-realtime"),
}
COLUMNS = ("p50_ms", "p99_ms", "p999_ms", "max_ms", "cpu_percent", "rss_mb", "first_call_ms")


def main() -> None:
    """Measure under each setting, print one table per setting, write both."""
    options = _options()
    result: dict[str, Any] = {"ticks": options.ticks}
    for name in options.settings or MACHINE_SETTINGS:
        result[name] = measured = _measured(name, MACHINE_SETTINGS[name], options)
        print(f"\n{name} (budget {measured['budget_ms']:.2f} ms, {options.ticks} ticks a row)\n")
        print(_table(measured["rows"]), flush=True)
        if options.json:  # after each, since another's flight may fail a quarter of an hour later
            records.write(options.json, result)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="*", help="packages; default: all eight reference shapes")
    parser.add_argument("--settings", nargs="+", choices=MACHINE_SETTINGS, help="default: all")
    parser.add_argument("--ticks", type=int, default=TICKS)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def _measured(name: str, flags: tuple[str, ...], options: argparse.Namespace) -> dict[str, Any]:
    print(f"{name}: about {options.ticks / 32 / 60:.1f} minutes a row", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "rows.json"
        command = [sys.executable, "-m", "wakedeploy", "bench", "latency", *options.files]
        command += [*flags, "--ticks", str(options.ticks), "--json", str(answer)]
        status = subprocess.run(command, check=False).returncode
        if not answer.exists():
            sys.exit(status)
        rows: dict[str, Any] = json.loads(answer.read_text())
        return rows


def _table(rows: list[dict[str, Any]]) -> str:
    """A Markdown table."""
    head = "| architecture | p50 | p99 | p99.9 | max | CPU % | RSS MB | first call ms |"
    lines = [head, "|---|" + "---:|" * len(COLUMNS)]
    for row in rows:
        cells = " | ".join(f"{row[column]:.2f}" for column in COLUMNS)
        lines.append(f"| {row['arch']} | {cells} |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
