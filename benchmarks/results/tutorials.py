"""What the tutorials take from their record: what each block of commands printed."""

import re
from collections.abc import Mapping
from typing import Any

from benchmarks.results.section import Records

PAGES = ("first-predictor", "own-system", "mujoco-arm", "at-the-rig")
_SHOWN = re.compile(
    r"^```sh\n(?P<commands>(?:(?!^```$).*\n)*)```\n\n"
    r"<!-- output -->\n```text\n(?:(?!^```$).*\n)*```$",
    re.MULTILINE,
)


def filled(name: str, text: str, records: Records) -> str:
    """A tutorial with the outputs of its record; ValueError for a block that the record lacks."""
    blocks = records.json(f"tutorial-{name}.json")["blocks"]
    printed = {"\n".join(block["commands"]) + "\n": block for block in blocks}

    def instead(shown: re.Match[str]) -> str:
        if shown["commands"] not in printed:
            raise ValueError(
                f"{name}: run python -m benchmarks.tutorials {name} for\n{shown['commands']}"
            )
        return _block(shown["commands"], printed[shown["commands"]])

    return _SHOWN.sub(instead, text)


def _block(commands: str, block: Mapping[str, Any]) -> str:
    printed = "\n".join(line.rstrip() for line in block["printed"].strip().splitlines())
    return f"```sh\n{commands}```\n\n<!-- output -->\n```text\n{printed}\n```"
