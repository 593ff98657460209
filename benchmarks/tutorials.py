"""The tutorials, obeyed line by line in an empty folder, and what each line printed.

    python -m benchmarks.tutorials first-predictor own-system mujoco-arm at-the-rig

A block after a comment `<!-- file: NAME -->` is written to that file when its turn comes. Writes
docs/records/tutorial-NAME.json and the pictures that the tutorials show. `make results` puts the
outputs into the pages.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks import records

FOLDER = records.ROOT / "docs" / "tutorials"
BLOCK = re.compile(
    r"^(?:<!-- file: (?P<file>\S+) -->\n```\w+|```sh)\n(?P<body>.*?)^```$"
    r"(?P<shown>\n\n<!-- output -->)?",
    re.MULTILINE | re.DOTALL,
)
WIDTH = "110"  # of the terminal that a page shows
PICTURES = {  # of a tutorial's folder, by the name that pages know
    ("first-predictor", "runs/gantry/gru/s0/prediction.png"): "tutorial-prediction.png",
    ("first-predictor", "gru.png"): "tutorial-flight.png",
    ("own-system", "gap/figures/trace.png"): "tutorial-own-system.png",
}


def main() -> None:
    """Obey the tutorials named and keep what each printed and drew."""
    for name in _options().name:
        with tempfile.TemporaryDirectory() as folder:
            printed_blocks = [*obeyed(FOLDER / f"{name}.md", Path(folder))]
            for (page, drawn), kept in PICTURES.items():
                if page == name:
                    shutil.copyfile(Path(folder) / drawn, records.FIGURES / kept)
        records.write(records.FOLDER / f"tutorial-{name}.json", {"blocks": printed_blocks})


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    names = sorted(page.stem for page in FOLDER.glob("*.md"))
    parser.add_argument("name", nargs="+", choices=names)
    return parser.parse_args()


def blocks(page: Path) -> list[tuple[str | None, str, bool]]:
    """A page's blocks in their order: each one's file, its text, and whether its output is shown.

    A block without a file is of the shell.
    """
    found = BLOCK.finditer(page.read_text("utf-8"))
    return [(block["file"], block["body"], block["shown"] is not None) for block in found]


def obeyed(page: Path, folder: Path) -> Iterator[dict[str, Any]]:
    """What each block of the shell printed where the page shows it, files made in between.

    Raises RuntimeError at the first block that fails.
    """
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    environment = os.environ | {"PATH": path, "COLUMNS": WIDTH, "NO_COLOR": "1"}
    for file, block, is_shown in blocks(page):
        if file is not None:
            (folder / file).write_text(block, "utf-8")
            continue
        began = time.monotonic()
        done = subprocess.run(
            ["bash", "-e"], input=block, cwd=folder, env=environment, capture_output=True, text=True
        )
        if done.returncode:
            raise RuntimeError(f"{page.name}: {block}{done.stdout}{done.stderr}")
        seconds = round(time.monotonic() - began, 1)
        printed = {"printed": done.stdout} if is_shown else {}
        yield {"commands": block.splitlines(), "seconds": seconds} | printed


if __name__ == "__main__":
    main()
