"""docs/rig.md against what it speaks of: pins, picture, commands, names of endings."""

import importlib.util
import re
import shlex
from pathlib import Path

import click
import pytest

from runtime.run import HINTS
from wakedeploy.cli import main

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "rig.md").read_text("utf-8")
COMMANDS = [
    line.strip()
    for block in re.findall(r"```\n(.*?)```", PAGE, re.DOTALL)
    for line in block.splitlines()
    if line.strip().startswith("wakedeploy ")
]


def drawing():
    """The script that draws the wiring, which is no module of a package."""
    spec = importlib.util.spec_from_file_location("wiring", ROOT / "docs" / "wiring.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_picture_and_the_table_have_the_sketchs_pins() -> None:
    wiring = drawing()
    pins = wiring.pins(wiring.PINS.read_text("utf-8"))
    assert set(pins) == {"SOURCE_ESC", "SUFFERER_ESC", "STEP", "DIRECTION", "HOME", "BATTERY"}
    assert (ROOT / "docs" / "wiring.svg").read_text("utf-8") == wiring.draw(pins)
    words = {
        "SOURCE_ESC": "source's ESC",
        "SUFFERER_ESC": "sufferer's ESC",
        "STEP": "step input",
        "DIRECTION": "direction input",
        "HOME": "home switch",
        "BATTERY": "divider",
    }
    for name, pin in pins.items():
        (row,) = [line for line in PAGE.splitlines() if line.startswith(f"| UNO {pin} |")]
        assert words[name] in row


@pytest.mark.parametrize("line", COMMANDS)
def test_every_command_of_the_page_is_one(line: str) -> None:
    words = shlex.split(line)[1:]
    command, context = main, click.Context(main, info_name="wakedeploy")
    while isinstance(command, click.Group):
        name, command, words = command.resolve_command(context, words)
        assert command is not None, name
        if isinstance(command, click.Group):
            context = click.Context(command, info_name=name, parent=context)
    parser = command.make_parser(context)
    values, left, _ = parser.parse_args(list(words))  # raises for an option that is not there
    positional = sum(1 for p in command.params if isinstance(p, click.Argument))
    assert len(left) <= positional or not left
    assert values


def test_every_ending_is_explained() -> None:
    table = PAGE[PAGE.index("## When a flight ends early") :]
    assert set(re.findall(r"`([a-z]+_[a-z]+)`", table)) - {"steps_per_m"} >= set(HINTS)
    assert len(COMMANDS) > 15
