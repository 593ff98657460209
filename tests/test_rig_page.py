"""docs/rig.md against what it speaks of: pins, picture, commands, names of endings."""

import importlib.util
import re
import shlex
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from runtime.run import HINTS
from wakedeploy.cli import main
from wakedeploy.cli.doctor import CALIBRATIONS
from wakedeploy.rig import default_rig_text, read_rig

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


def virtual(line: str) -> list[str]:
    """A command of the page as the page says to rehearse it at a desk."""
    words = shlex.split(line.replace("--port /dev/wakedeploy-uno", "--virtual"))[1:]
    if words[0] == "calibrate":
        words += ["--out", "desk.toml"]
    return [word for word in words if word != "--realtime"]  # not every machine allows it


@pytest.mark.slow
def test_the_page_can_be_rehearsed_from_its_first_command_to_its_last(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "wakedeploy"
    (folder / "flights").mkdir(parents=True)
    for line in COMMANDS:
        if line.startswith("wakedeploy deploy "):
            (folder / "current.onnx").write_bytes(Path("gru.onnx").read_bytes())
            continue
        told = CliRunner().invoke(main, virtual(line))
        assert told.exit_code == 0, f"{line}\n{told.output}"
    calibrated = read_rig(Path("desk.toml")).calibration
    assert {name for name in CALIBRATIONS if name not in calibrated} == set()
    assert (folder / "rig.toml").read_text() == default_rig_text()


def test_nothing_turns_before_what_needs_no_motor_and_paths_are_one() -> None:
    words = [tuple(shlex.split(line)[1:3]) for line in COMMANDS]
    first_flight = next(i for i, w in enumerate(words) if w[0] == "run-gantry")
    assert {("calibrate", "zero"), ("calibrate", "steps")} <= set(words[:first_flight])
    assert set(re.findall(r"--rig ([^\s`]+)", PAGE)) == {"wakedeploy/rig.toml"}
    unit = (ROOT / "deployment" / "wakedeploy-gantry@.service").read_text("utf-8")
    (service,) = re.findall(r"^ExecStart=(.*?[^\\])$", unit, re.MULTILINE | re.DOTALL)
    flown = next(line for line in COMMANDS if "--package" in line)
    for option in ("--rig", "--package", "--port"):
        asked = re.findall(rf"{option} (\S+)", flown)
        assert asked == re.findall(rf"{option} (\S+)", service)
    assert service.startswith("/opt/wakedeploy/bin/wakedeploy ")
    assert "/opt/wakedeploy/bin/pip install '.[rig]'" in PAGE


def test_every_ending_is_explained() -> None:
    table = PAGE[PAGE.index("## When a flight ends early") :]
    assert set(re.findall(r"`([a-z]+_[a-z]+)`", table)) - {"steps_per_m"} >= set(HINTS)
    assert len(COMMANDS) > 15
