"""Simulate the thresholds that ship with the package, for the default rig with and without spool.

Writes `thresholds.json` beside the gantry's search: by the rig's hash, what sets of five flights
each without any missing effect, with constants and forms off as the rig file allows, exceed
together once in twenty. Takes about half an hour on a core: `python -m benchmarks.gap_thresholds`.
"""

import json
import sys
from dataclasses import asdict
from pathlib import Path

from wakedeploy.core.files import write_text_whole
from wakedeploy.gap.systems.gantry.search import threshold
from wakedeploy.rig.file import default_rig

SETS = {"default": 20, "without spool": 10}


def main() -> None:
    """Simulate, and write the file."""
    rigs = {"default": default_rig(), "without spool": default_rig().without("spool")}
    by_rig = {}
    for name, rig in rigs.items():
        null = threshold.simulate(rig, sets=SETS[name], progress=_tell(name))
        found = asdict(threshold.quantiles(null))
        of = {"rig": name, "sets": len(null), "searched_with": threshold.searched_with(rig)}
        by_rig[rig.sha256] = of | found
    path = Path(threshold.__file__).with_name("thresholds.json")
    shipped = {"version": threshold.VERSION, "rigs": by_rig}
    write_text_whole(path, json.dumps(shipped, indent=1) + "\n")


def _tell(name: str):
    return lambda done, sets: print(f"{name}: {done} of {sets}", file=sys.stderr)


if __name__ == "__main__":
    main()
