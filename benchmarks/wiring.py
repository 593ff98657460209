"""Draw how the rig is wired: `python -m benchmarks.wiring` writes docs/figures/wiring.svg.

Pin numbers are read from `arduino_sketch/pins.h`, so that picture and sketch cannot differ. A wire
ends at a part's terminal or on another wire of its net; where wires of one net meet is a dot, where
others cross one of them hops.
"""

import itertools
import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parents[1]
PINS = ROOT / "arduino_sketch" / "pins.h"
PICTURE = ROOT / "docs" / "figures" / "wiring.svg"
POWER, SIGNAL, GROUND, BUS = "#b5322a", "#1f5f99", "#555555", "#2b7a3d"
_WIDTH, _HEIGHT = 1110, 730
_HOP, _DOT = 5, 4
_RAIL_X, _BUS_X = 600, 500  # of ground, and of what the emergency stop cuts

Point = tuple[int, int]


@dataclass(frozen=True)
class Box:
    """A part: its corner, its size, its name, what else there is to say, and its terminals.

    A terminal lies on an edge ("left", "right", "top", "bottom") at a distance from the corner; its
    name is written beside it.
    """

    x: int
    y: int
    width: int
    height: int
    name: str
    note: str = ""
    terminals: dict[str, tuple[str, int]] = field(default_factory=dict)
    shift: int = 0  # of the texts, to make room for labels

    def at(self, terminal: str) -> Point:
        """Where a terminal is."""
        edge, along = self.terminals[terminal]
        if edge in ("left", "right"):
            return (self.x if edge == "left" else self.x + self.width), self.y + along
        return self.x + along, (self.y if edge == "top" else self.y + self.height)

    def svg(self) -> str:
        """The box with its texts; a note's lines are split at "|"."""
        middle = self.x + self.width // 2 + self.shift
        lines = [line for line in self.note.split("|") if line]
        top = self.y + (self.height - 15 * len(lines)) // 2 + 5
        drawn = [
            f'<rect x="{self.x}" y="{self.y}" width="{self.width}" height="{self.height}" rx="6" '
            'fill="#f6f4ef" stroke="#333333" stroke-width="1.4"/>',
            text(middle, top, self.name, anchor="middle", bold=True),
        ]
        for number, line in enumerate(lines, 1):
            drawn.append(text(middle, top + 15 * number, line, anchor="middle", size=11))
        for label, (edge, _) in self.terminals.items():
            x, y = self.at(label)
            if edge == "left":
                drawn.append(text(x + 7, y + 4, label, size=11))
            elif edge == "right":
                drawn.append(text(x - 7, y + 4, label, anchor="end", size=11))
            else:
                drawn.append(text(x, y + (14 if edge == "top" else -6), label, "middle", 11))
        return "\n".join(drawn)


@dataclass(frozen=True)
class Wire:
    """A piece of a net along corners, with words beside it."""

    net: str
    colour: str
    points: tuple[Point, ...]
    label: str = ""
    label_at: Point = (0, 0)

    @property
    def pieces(self) -> list[tuple[Point, Point]]:
        """Its straight pieces."""
        return list(itertools.pairwise(self.points))


def text(x: int, y: int, words: str, anchor: str = "start", size: int = 13, bold: bool = False,
         colour: str = "#222222") -> str:  # fmt: skip
    """One line of text."""
    weight = ' font-weight="bold"' if bold else ""
    return (
        f'<text x="{x}" y="{y}" font-size="{size}" text-anchor="{anchor}" fill="{colour}"{weight}>'
        f"{escape(words)}</text>"
    )


def pins(source: str) -> dict[str, str]:
    """The sketch's pins by name, as the board's print has them: D9, A0."""
    found = dict(re.findall(r"const uint8_t (\w+)_PIN = (\w+);", source))
    return {name: pin if pin.startswith("A") else f"D{pin}" for name, pin in found.items()}


def parts(pin: dict[str, str]) -> dict[str, Box]:
    """Every part by its name."""
    esc = {"+": ("left", 18), "−": ("left", 38), "signal": ("left", 62), "GND": ("left", 82),
           "": ("right", 50)}  # fmt: skip
    uno = {
        **{pin[name]: ("right", 30 + 30 * place) for place, name in enumerate(
            ("SOURCE_ESC", "SUFFERER_ESC", "STEP", "DIRECTION"))},
        pin["HOME"]: ("right", 170), "GND": ("right", 210),
        pin["BATTERY"]: ("left", 50), "USB": ("left", 100), "jack": ("bottom", 105),
    }  # fmt: skip
    bec = "its red BEC|wire left open"
    boxes = [
        Box(30, 50, 150, 70, "Flight battery", "fuse at its plug",
            {"+": ("right", 20), "−": ("right", 50)}, -8),
        Box(250, 40, 180, 70, "Emergency stop", "cuts both ESCs,|latching",
            {"in": ("left", 30), "out": ("right", 30)}),
        Box(700, 30, 190, 100, "ESC, source", bec, esc, 22),
        Box(700, 160, 190, 100, "ESC, sufferer", bec, esc, 22),
        Box(960, 50, 130, 60, "Motor, source", "", {"": ("left", 30)}),
        Box(960, 180, 130, 60, "Motor, sufferer", "", {"": ("left", 30)}),
        Box(250, 195, 180, 75, "Divider", "behind the stop",
            {"30 kΩ": ("right", 18), "10 kΩ": ("right", 57), "middle": ("bottom", 50)}, -22),
        Box(330, 330, 210, 250, "Arduino UNO", "", uno),
        Box(330, 650, 210, 56, "UNO supply", "7 to 12 V, its own", {"": ("top", 105)}),
        Box(30, 380, 170, 100, "Raspberry Pi 5", "runs wakedeploy",
            {"USB": ("right", 50), "header": ("bottom", 40)}, -14),
        Box(30, 590, 180, 70, "VL53L0X", "on the carriage's base,|looks up at the reflector",
            {"": ("top", 40)}),
        Box(700, 290, 190, 56, "Stepper supply", "its own, off while you wire",
            {"": ("bottom", 95)}),
        Box(700, 380, 190, 116, "Stepper driver", "takes pulses|of 5 µs at 5 V",
            {"step": ("left", 20), "direction": ("left", 45), "GND": ("left", 95),
             "motor": ("right", 95), "supply": ("top", 95)}, 28),
        Box(960, 450, 130, 50, "NEMA 23", "", {"": ("left", 25)}),
        Box(700, 550, 190, 70, "Home switch", "closed while the|carriage is at home",
            {"NO": ("left", 20), "GND": ("left", 50)}, 18),
    ]  # fmt: skip
    return {box.name: box for box in boxes}


def wires(pin: dict[str, str]) -> list[Wire]:
    """Every wire; those of a net have its name."""
    boxes = parts(pin)

    def at(part: str, terminal: str) -> Point:
        return boxes[part].at(terminal)

    def uno(name: str) -> Point:
        return at("Arduino UNO", pin.get(name, name))

    def signal(name: str, turn_x: int, end: Point) -> Wire:
        start = uno(name)
        return Wire(pin[name], SIGNAL, (start, (turn_x, start[1]), (turn_x, end[1]), end))

    def branch(net: str, colour: str, x: int, *ends: Point) -> list[Wire]:
        return [Wire(net, colour, (end, (x, end[1]))) for end in ends]

    escs = ("ESC, source", "ESC, sufferer")
    minus, middle = at("Flight battery", "−"), at("Divider", "middle")
    to_ground = [
        *(at(esc, terminal) for esc in escs for terminal in ("−", "GND")),
        at("Divider", "10 kΩ"), uno("GND"), at("Stepper driver", "GND"), at("Home switch", "GND"),
    ]  # fmt: skip
    behind_stop = [*(at(esc, "+") for esc in escs), at("Emergency stop", "out"),
                   at("Divider", "30 kΩ")]  # fmt: skip
    rail_y = [y for _, y in to_ground]
    bus_y = [y for _, y in behind_stop]
    return [
        Wire("ground", GROUND, ((_RAIL_X, min(rail_y)), (_RAIL_X, max(rail_y))),
             "ground", (_RAIL_X - 46, 306)),
        *branch("ground", GROUND, _RAIL_X, *to_ground),
        Wire("ground", GROUND, (minus, (215, minus[1]), (215, 150), (_RAIL_X, 150))),
        Wire("battery", POWER, (at("Flight battery", "+"), at("Emergency stop", "in"))),
        Wire("behind the stop", POWER, ((_BUS_X, min(bus_y)), (_BUS_X, max(bus_y)))),
        *branch("behind the stop", POWER, _BUS_X, *behind_stop),
        *(Wire(f"phases of {esc}", POWER, (at(esc, ""), at(motor, "")), "3 phases",
               (903, at(esc, "")[1] - 7))
          for esc, motor in zip(escs, ("Motor, source", "Motor, sufferer"), strict=True)),
        Wire("stepper's supply", POWER, (at("Stepper supply", ""), at("Stepper driver",
             "supply")), "2 wires", (803, 368)),
        Wire("coils", POWER, (at("Stepper driver", "motor"), at("NEMA 23", "")), "4 wires",
             (903, 468)),
        Wire("UNO's supply", POWER, (at("UNO supply", ""), uno("jack")),
             "barrel plug", (443, 620)),
        Wire(pin["BATTERY"], SIGNAL, (middle, (middle[0], uno("BATTERY")[1]), uno("BATTERY"))),
        signal("SOURCE_ESC", 650, at("ESC, source", "signal")),
        signal("SUFFERER_ESC", 670, at("ESC, sufferer", "signal")),
        signal("STEP", 630, at("Stepper driver", "step")),
        signal("DIRECTION", 650, at("Stepper driver", "direction")),
        signal("HOME", 650, at("Home switch", "NO")),
        Wire("USB", BUS, (at("Raspberry Pi 5", "USB"), uno("USB")), "data", (240, 424)),
        Wire("I²C", BUS, (at("Raspberry Pi 5", "header"), at("VL53L0X", "")),
             "pins 1 (3.3 V), 3 (SDA),|5 (SCL), 6 (GND)", (78, 525)),
    ]  # fmt: skip


def crossings(drawn: list[Wire]) -> set[tuple[Point, str]]:
    """Where a level piece of a wire crosses an upright one of another net, and the level's net."""
    pieces = [(wire.net, *piece) for wire in drawn for piece in wire.pieces]
    return {
        ((begin[0], across[1]), net)
        for (net, across, across_end), (upright, begin, end) in itertools.product(pieces, pieces)
        if net != upright and across[1] == across_end[1] and begin[0] == end[0]
        and min(across[0], across_end[0]) < begin[0] < max(across[0], across_end[0])
        and min(begin[1], end[1]) < across[1] < max(begin[1], end[1])
    }  # fmt: skip


def junctions(drawn: list[Wire]) -> set[Point]:
    """Where a wire ends on another one of its net, other than at that one's end."""
    return {
        end
        for wire, other in itertools.permutations(drawn, 2)
        if wire.net == other.net
        for end in (wire.points[0], wire.points[-1])
        for piece in other.pieces
        if lies_on(end, piece) and end not in (other.points[0], other.points[-1])
    }


def lies_on(point: Point, piece: tuple[Point, Point]) -> bool:
    """Whether a point is on a straight piece, its ends included."""
    return all(
        min(first, last) <= at <= max(first, last)
        for at, first, last in zip(point, *piece, strict=True)
    )


def path(wire: Wire, hops: set[tuple[Point, str]]) -> str:
    """A wire as SVG, with an arc over each upright one that it crosses."""
    words = [f"M{wire.points[0][0]},{wire.points[0][1]}"]
    for (x, y), (end_x, end_y) in wire.pieces:
        step = 1 if end_x > x else -1
        over = {at[0] for at, net in hops if net == wire.net and at[1] == y == end_y}
        for hop_x in sorted((at for at in over if min(x, end_x) < at < max(x, end_x)),
                            reverse=step < 0):  # fmt: skip
            sweep = int(step > 0)
            words.append(
                f"H{hop_x - step * _HOP}A{_HOP},{_HOP} 0 0 {sweep} {hop_x + step * _HOP},{y}"
            )
        words.append(f"L{end_x},{end_y}")
    return f'<path d="{"".join(words)}" fill="none" stroke="{wire.colour}" stroke-width="2"/>'


def draw(pin: dict[str, str]) -> str:
    """The whole picture as SVG."""
    drawn_wires = wires(pin)
    hops, colours = crossings(drawn_wires), {wire.net: wire.colour for wire in drawn_wires}
    dots = [
        f'<circle cx="{x}" cy="{y}" r="{_DOT}" fill="{colours[wire.net]}"/>'
        for x, y in sorted(junctions(drawn_wires))
        for wire in drawn_wires
        if any(lies_on((x, y), piece) for piece in wire.pieces)
    ]
    drawn = [
        *(path(wire, hops) for wire in drawn_wires),
        *sorted(set(dots)),
        *(text(wire.label_at[0], wire.label_at[1] + 15 * row, words, size=11, colour=wire.colour)
          for wire in drawn_wires if wire.label for row, words in enumerate(wire.label.split("|"))),
        *(box.svg() for box in parts(pin).values()),
        text(30, 24, "Power", colour=POWER, bold=True),
        text(90, 24, "signal", colour=SIGNAL, bold=True),
        text(150, 24, "USB and I²C", colour=BUS, bold=True),
        text(250, 24, "ground", colour=GROUND, bold=True),
    ]  # fmt: skip
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" '
        f'width="{_WIDTH}" height="{_HEIGHT}" font-family="sans-serif">\n'
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="white"/>\n'
        + "\n".join(drawn)
        + "\n</svg>\n"
    )


if __name__ == "__main__":
    PICTURE.write_text(draw(pins(PINS.read_text("utf-8"))), encoding="utf-8")
