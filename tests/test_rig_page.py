"""docs/how-to/rig.md against its subject: pins, picture, what the Pi gets, names of endings."""

import itertools
import os
import re
import shlex
import subprocess
import tomllib
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from benchmarks import wiring
from runtime.loop.loop import Loop
from runtime.reference import random_plan
from runtime.simulated import SimulatedGantry
from wakedeploy.physics.gantry import GantryPlant
from wakedeploy.rig.file import default_rig

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "how-to" / "rig.md").read_text("utf-8")
COMMANDS = [
    line.strip()
    for block in re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    for line in block.splitlines()
    if line.strip().startswith("wakedeploy ")
]


def test_the_picture_and_the_table_have_the_sketchs_pins() -> None:
    pins = wiring.pins(wiring.PINS.read_text("utf-8"))
    assert set(pins) == {"SOURCE_ESC", "SUFFERER_ESC", "STEP", "DIRECTION", "HOME", "BATTERY"}
    assert wiring.PICTURE.read_text("utf-8") == wiring.draw(pins)
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


# How the table names the parts of the drawing, longest first: what is found is cut out.
NAMED = {
    "source's ESC": ["ESC, source"],
    "sufferer's ESC": ["ESC, sufferer"],
    "both ESCs' minus and signal grounds": ["ESC, source", "ESC, sufferer"],
    "both ESCs' plus": ["ESC, source", "ESC, sufferer"],
    "source's motor": ["Motor, source"],
    "sufferer's motor": ["Motor, sufferer"],
    "stepper driver": ["Stepper driver"],
    "stepper supply": ["Stepper supply"],
    "NEMA 23": ["NEMA 23"],
    "home switch": ["Home switch"],
    "emergency stop": ["Emergency stop"],
    "divider": ["Divider"],
    "battery": ["Flight battery"],
    "VL53L0X": ["VL53L0X"],
    "Pi ": ["Raspberry Pi 5"],
    "UNO supply": ["UNO supply"],
    "UNO": ["Arduino UNO"],
}


def drawn_nets():
    """The drawing's nets: name -> its wires; and the parts by name."""
    pins = wiring.pins(wiring.PINS.read_text("utf-8"))
    nets = {}
    for wire in wiring.wires(pins):
        nets.setdefault(wire.net, []).append(wire.points)
    return nets, wiring.parts(pins)


def on(point, one, other):
    """Whether a point is on a level or upright line."""
    (x, y), (ax, ay), (bx, by) = point, one, other
    return min(ax, bx) <= x <= max(ax, bx) and min(ay, by) <= y <= max(ay, by)


def on_edge(point, box):
    (x, y), right, bottom = point, box.x + box.width, box.y + box.height
    is_inside = box.x <= x <= right and box.y <= y <= bottom
    return is_inside and (x in (box.x, right) or y in (box.y, bottom))


def test_no_wire_of_the_drawing_ends_in_empty_space_or_on_another_net() -> None:
    nets, parts = drawn_nets()
    for name, wires in nets.items():
        for wire in wires:
            assert all(a[0] == b[0] or a[1] == b[1] for a, b in itertools.pairwise(wire))
            for end in (wire[0], wire[-1]):
                others = [w for w in wires if w is not wire]
                joined = any(on(end, a, b) for w in others for a, b in itertools.pairwise(w))
                assert joined or any(on_edge(end, box) for box in parts.values()), (name, end)
            foreign = [w for other, ws in nets.items() if other != name for w in ws]
            assert not any(
                on(corner, a, b)
                for corner in wire
                for w in foreign
                for a, b in itertools.pairwise(w)
            ), name


def test_each_net_of_the_drawing_is_one_piece() -> None:
    for name, wires in drawn_nets()[0].items():
        reached, left = [wires[0]], list(wires[1:])
        for wire in reached:  # grows
            for other in list(left):
                ends = [(e, other) for e in (wire[0], wire[-1])]
                ends += [(e, wire) for e in (other[0], other[-1])]
                if any(on(e, a, b) for e, w in ends for a, b in itertools.pairwise(w)):
                    reached.append(other)
                    left.remove(other)
        assert left == [], name


def test_each_row_of_the_table_has_a_wire_that_ends_at_every_part_it_names() -> None:
    nets, parts = drawn_nets()
    touched = {
        net: {
            name
            for name, box in parts.items()
            if any(on_edge(end, box) for w in wires for end in (w[0], w[-1]))
        }
        for net, wires in nets.items()
    }
    table = PAGE[PAGE.index("## Wiring") : PAGE.index("- **Do not fly")]
    rows = [line.strip("| ") for line in table.splitlines() if line.startswith("|")][2:]
    used = set()
    for row in rows:
        left, named = row, set()
        for words, names in NAMED.items():
            if words in left:
                left, named = left.replace(words, ""), named | set(names)
        assert len(named) >= 2, row
        fitting = {net for net, ends in touched.items() if named <= ends}
        pin = re.match(r"UNO ([AD]\d+) ", row)
        fitting &= {pin[1]} if pin else fitting
        assert fitting, row
        used |= fitting
    assert len(rows) == 16
    assert used == set(nets)  # and the drawing has none that the table does not name


def test_where_wires_meet_is_a_dot_and_where_they_cross_a_hop() -> None:
    nets, _ = drawn_nets()
    svg = wiring.PICTURE.read_text("utf-8")
    meet, cross = set(), set()
    pieces = [(n, p) for n, ws in nets.items() for w in ws for p in itertools.pairwise(w)]
    for (net, (a, b)), (other, (c, d)) in itertools.permutations(pieces, 2):
        if a[1] == b[1] and c[0] == d[0] and on((c[0], a[1]), a, b) and on((c[0], a[1]), c, d):
            at = (c[0], a[1])
            if net != other:
                cross.add(at)
            elif at not in (c, d):
                meet.add(at)
    dots = {(int(x), int(y)) for x, y in re.findall(r'<circle cx="(\d+)" cy="(\d+)"', svg)}
    arcs = re.findall(r"H(\d+)A5,5 0 0 \d (\d+),(\d+)", svg)
    hops = {((int(x) + int(end_x)) // 2, int(y)) for x, end_x, y in arcs}
    assert dots == meet
    assert hops == cross
    assert len(cross) > 8


@pytest.mark.whole
def test_bare_motors_never_get_more_than_the_page_says() -> None:
    """Nothing lifts without propellers, and the integral asks for ever more."""
    ((low, high),) = re.findall(r"`limits.pulse_us = \[(\d+), (\d+)\]`", PAGE)
    for pulse_us, cause in (((float(low), float(high)), ()), ((1000.0, 2000.0), ("thrust_lost",))):
        rig = default_rig().changed(limits={"pulse_us": pulse_us})
        idle = (1000.0, 1000.0)
        plant = GantryPlant(rig, seed=1, command_hook=lambda t, source, sufferer, dt, i=idle: i)
        gantry = SimulatedGantry(plant, truth=rig, seed=1)
        rows: list[dict[str, Any]] = []
        sink = SimpleNamespace(error=None, put=rows.append)
        loop = Loop(rig, gantry, gantry, random_plan(rig, 6.0, 0), None, sink, gantry)
        loop.run()
        assert loop.failsafe_cause == cause
        asked_us = [row["sufferer_cmd_us"] for row in rows]
        assert max(asked_us) == pytest.approx(pulse_us[1], abs=1.0)
        assert sum(us > 1900.0 for us in asked_us) / 32.0 < 1.5


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


# The far end of a line of ssh, played by a shell with another home.
SSH = '#!/bin/sh\ncd "$(dirname "$0")/../home" && exec sh -c "$2"\n'
OF_THE_REPOSITORY = re.compile(r"[\w@-]+([./][\w@.-]+)+")


def on_the_pi() -> list[list[str]]:
    """The words of each line that sets the Pi up: the page's, and those of the files to install."""
    (page,) = re.findall(r"Then on the Pi:\n\n```sh\n(.*?)```", PAGE, re.DOTALL)
    comments = [
        line.removeprefix("#   ")
        for file in sorted((ROOT / "deployment").glob("*wakedeploy*"))
        for line in file.read_text("utf-8").splitlines()
        if line.startswith("#   ")
    ]
    return [shlex.split(line) for line in [*page.splitlines(), *comments]]


def test_what_the_laptop_sends_holds_all_that_is_installed_on_the_pi(tmp_path: Path) -> None:
    (sending,) = re.findall(r"^git archive .*$", PAGE, re.MULTILINE)
    ssh, home = tmp_path / "bin" / "ssh", tmp_path / "home"
    home.mkdir()
    ssh.parent.mkdir()
    ssh.write_text(SSH)
    ssh.chmod(0o755)
    environment = os.environ | {"PATH": f"{ssh.parent}:{os.environ['PATH']}"}
    packing, unpacking = map(shlex.split, sending.split(" | "))
    sent = subprocess.run(packing, cwd=ROOT, capture_output=True, check=True).stdout
    subprocess.run(unpacking, input=sent, env=environment, check=True)
    lines = on_the_pi()
    assert lines[0][0] == "cd"
    checkout = home / lines[0][1].removeprefix("~/")
    wanted = {word for line in lines for word in line if OF_THE_REPOSITORY.fullmatch(word)}
    installed = {"deployment/60-wakedeploy.rules", "deployment/wakedeploy-gantry@.service"}
    assert wanted >= installed | {"constraints.txt"}
    assert {name for name in wanted if not (checkout / name).is_file()} == set()


def test_the_pi_installs_this_project_with_extras_that_it_has() -> None:
    (line,) = [line for line in on_the_pi() if "/opt/wakedeploy/bin/pip" in line]
    extras = re.fullmatch(r"\.\[([\w,]+)\]", line[-1])
    assert extras is not None
    known = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert set(extras[1].split(",")) <= set(known)


def test_every_ending_is_explained() -> None:
    page = (ROOT / "docs" / "reference" / "endings.md").read_text("utf-8")
    assert "```{made} faults\n" in page  # of HINTS: tests/docs/test_site.py
