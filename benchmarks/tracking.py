"""The tracking table: what feeding the wake's force forward is worth, and what the lead adds.

Makes the default gantry set, trains and exports the eight at lead 0 and at the rig's lead, then
flies PID alone, the true force at both leads, and all sixteen packages over the same flights, none
of which was trained on. Everything lies in one folder and is made once: a second call goes on.

    OMP_NUM_THREADS=1 python -m benchmarks.tracking --json docs/records/tracking.json
"""

import argparse
import functools
import math
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks import records
from trainers.build import ARCHITECTURES
from wakedeploy.core.episodes import stated_sha256
from wakedeploy.core.manifest import Parity
from wakedeploy.core.package import read_package
from wakedeploy.core.parallel import parallel_map
from wakedeploy.domains.gantry import record
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import default_rig

FIRST_SEED = 900_000_000  # far from every training seed
SECONDS = 25.0


@dataclass(frozen=True)
class Contender:
    """One line of the table: PID alone, an oracle, or a package."""

    name: str
    lead_s: float | None
    package: Path | None = None
    parity: Parity | None = None


def main() -> None:
    """Make what is missing, fly, print the table, write it."""
    options = _options()
    work, lead_s = options.work / f"{options.minutes:g}-minutes", default_lead_s(default_rig())
    data_sha256 = _made(work / "set", options.minutes)
    wanted = [(arch, lead) for lead in (0.0, lead_s) for arch in ARCHITECTURES]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        packages = list(pool.map(lambda job: _package(work, *job), wanted))
    for path in packages:
        if read_package(path).manifest.data_sha256 != data_sha256:
            sys.exit(f"{path} is of another set than {work / 'set'}: give another --work.")
    contenders = [
        Contender("PID alone", None),
        Contender("true force", 0.0),
        Contender("true force", lead_s),
        *(_contender(path) for path in packages),
    ]
    rows = [_flown(contender, options.flights) for contender in contenders]
    print(_table(rows))
    if options.json:
        conditions = {"seconds": SECONDS, "minutes": options.minutes, "data_sha256": data_sha256}
        records.write(options.json, conditions | {"rows": rows})


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, default=Path("tracking"))
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--flights", type=int, default=24)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def _made(folder: Path, minutes: float) -> str:
    """The hash of the set, simulated if it is not there yet."""
    if not (folder / "dataset.json").exists():
        _run("data", "make", "gantry", "--out", folder, "--minutes", minutes, "--seed", 0)
    return stated_sha256(folder)


def _package(work: Path, arch: str, lead_s: float) -> Path:
    """The package of one architecture at one lead, trained and exported if it is not there yet."""
    path = work / f"{arch}-lead{1e3 * lead_s:.0f}ms.onnx"
    if not path.exists():
        runs, data = work / f"runs-lead{1e3 * lead_s:.0f}ms", work / "set"
        _run("train", "--data", data, "--arch", arch, "--lead", lead_s, "--out", runs)
        run = runs / "gantry" / arch / "s0"
        _run("export", "--arch", arch, "--run", run, "--data", data, "--out", path)
    return path


def _run(*arguments: object) -> None:
    command = [sys.executable, "-m", "wakedeploy", *(str(a) for a in arguments)]
    subprocess.run(command, check=True)


def _contender(path: Path) -> Contender:
    manifest = read_package(path).manifest
    return Contender(manifest.arch, manifest.lead_s, path, manifest.parity)


def _flown(contender: Contender, flights: int) -> dict[str, object]:
    """The contender's row: tracking RMSE [mm] over flights, mean and its 95 % half width."""
    errors = parallel_map(functools.partial(_rmse_mm, contender), range(flights))
    half_width = 2.0 * float(np.std(errors, ddof=1)) / math.sqrt(flights)
    row = {
        "name": contender.name,
        "lead_s": contender.lead_s,
        "rmse_mm": float(np.mean(errors)),
        "half_width_mm": half_width,
        "flights": flights,
    }
    if contender.parity is not None:
        row["parity"] = contender.parity.model_dump()
    print(f"{contender.name} {contender.lead_s}: {row['rmse_mm']:.2f} mm", file=sys.stderr)
    return row


def _rmse_mm(contender: Contender, flight: int) -> float:
    oracle_s = contender.lead_s if contender.package is None else None
    log = record(
        None,
        seconds=SECONDS,
        seed=FIRST_SEED + flight,
        package=contender.package,
        lead_oracle_s=oracle_s,
    )
    return 1e3 * log.tracking_rmse_m("true_z_m")


def _table(rows: list[dict[str, object]]) -> str:
    """The table as Markdown, one line per contender, leads side by side."""
    leads = sorted({row["lead_s"] for row in rows if row["lead_s"] is not None})
    lines = [
        "| feedforward | " + " | ".join(f"lead {1e3 * lead:.0f} ms" for lead in leads) + " |",
        "|---|" + "---|" * len(leads),
    ]
    for name in dict.fromkeys(row["name"] for row in rows):
        cells = {row["lead_s"]: row for row in rows if row["name"] == name}
        shown = [cells.get(lead) or cells.get(None) for lead in leads]
        values = [f"{r['rmse_mm']:.1f} ± {r['half_width_mm']:.1f}" for r in shown if r]
        lines.append(f"| {name} | " + " | ".join(values) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
