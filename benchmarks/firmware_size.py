"""How much of the UNO the sketch takes, and how much it may.

python -m benchmarks.firmware_size --json docs/records/firmware-size.json
"""

import argparse
import sys
from pathlib import Path

from benchmarks import records
from runtime.virtual.firmware_build import (
    FLASH_BYTES,
    MOST_FLASH_BYTES,
    MOST_RAM_BYTES,
    RAM_BYTES,
    firmware,
)
from wakedeploy.core.errors import UnusableInput


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="benchmarks.firmware_size", description=__doc__)
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def main() -> None:
    """Compile, print, write."""
    options = _options()
    try:
        built = firmware()
    except UnusableInput as error:
        sys.exit(str(error))
    memories = {
        "flash": (built.flash_bytes, MOST_FLASH_BYTES, FLASH_BYTES),
        "RAM without the stack": (built.ram_bytes, MOST_RAM_BYTES, RAM_BYTES),
    }
    rows = [
        {"memory": name, "bytes": taken, "ceiling_bytes": ceiling, "chip_bytes": chip}
        for name, (taken, ceiling, chip) in memories.items()
    ]
    for row in rows:
        print(f"{row['memory']}: {row['bytes']} bytes of {row['chip_bytes']}, "
              f"at most {row['ceiling_bytes']}")  # fmt: skip
    if options.json:
        records.write(options.json, {"rows": rows})


if __name__ == "__main__":
    main()
