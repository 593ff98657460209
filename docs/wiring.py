"""Draw how the rig is wired: `python docs/wiring.py` writes docs/wiring.svg.

Pin numbers are read from `arduino_sketch/pins.h`, so that picture and sketch cannot differ.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import escape

HERE = Path(__file__).resolve().parent
PINS = HERE.parent / "arduino_sketch" / "pins.h"
POWER, SIGNAL, GROUND, BUS = "#b5322a", "#1f5f99", "#777777", "#2b7a3d"
_WIDTH, _HEIGHT = 980, 680


@dataclass(frozen=True)
class Box:
    """A part: its corner, its size, its name, and what else there is to say."""

    x: int
    y: int
    width: int
    height: int
    name: str
    note: str = ""

    def svg(self) -> str:
        """The box with its texts; a note's lines are split at "|"."""
        middle = self.x + self.width // 2
        lines = [line for line in self.note.split("|") if line]
        top = self.y + (self.height - 15 * len(lines)) // 2 + 5
        drawn = [
            f'<rect x="{self.x}" y="{self.y}" width="{self.width}" height="{self.height}" rx="6" '
            'fill="#f6f4ef" stroke="#333333" stroke-width="1.4"/>',
            text(middle, top, self.name, anchor="middle", bold=True),
        ]
        for number, line in enumerate(lines, 1):
            drawn.append(text(middle, top + 15 * number, line, anchor="middle", size=11))
        return "\n".join(drawn)


def text(x: int, y: int, words: str, anchor: str = "start", size: int = 13, bold: bool = False,
         colour: str = "#222222") -> str:  # fmt: skip
    """One line of text."""
    weight = ' font-weight="bold"' if bold else ""
    return (
        f'<text x="{x}" y="{y}" font-size="{size}" text-anchor="{anchor}" fill="{colour}"{weight}>'
        f"{escape(words)}</text>"
    )


def wire(colour: str, *points: tuple[int, int], label: str = "", at: tuple[int, int] = (0, 0),
         dashed: bool = False) -> str:  # fmt: skip
    """A wire along points, with a label at `at`."""
    path = " ".join(f"{x},{y}" for x, y in points)
    dashes = ' stroke-dasharray="5 4"' if dashed else ""
    line = f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="2"{dashes}/>'
    return line + (text(*at, label, size=11, colour=colour) if label else "")


def pins(source: str) -> dict[str, str]:
    """The sketch's pins by name, as the board's print has them: D9, A0."""
    found = dict(re.findall(r"const uint8_t (\w+)_PIN = (\w+);", source))
    return {name: pin if pin.startswith("A") else f"D{pin}" for name, pin in found.items()}


def draw(pin: dict[str, str]) -> str:
    """The whole picture as SVG."""
    boxes = [
        Box(30, 50, 150, 70, "Flight battery", "fuse at its plug"),
        Box(250, 50, 160, 70, "Emergency stop", "cuts both ESCs,|within reach, latching"),
        Box(560, 20, 160, 60, "ESC, source", "BEC wire left open"),
        Box(560, 110, 160, 60, "ESC, sufferer", "BEC wire left open"),
        Box(810, 20, 140, 60, "Motor, source"),
        Box(810, 110, 140, 60, "Motor, sufferer"),
        Box(250, 190, 160, 64, "Divider", "30 kΩ over 10 kΩ,|behind the stop"),
        Box(330, 320, 230, 230, "Arduino UNO", "powered by USB"),
        Box(30, 340, 190, 120, "Raspberry Pi 5", "runs wakedeploy"),
        Box(30, 570, 190, 70, "VL53L0X", "on the carriage's base,|looks up at the reflector"),
        Box(730, 220, 220, 56, "Stepper supply", "its own, off while you wire"),
        Box(730, 330, 220, 90, "Stepper driver", "step and direction,|inputs for 5 V"),
        Box(730, 464, 220, 56, "NEMA 23", "belt, carriage in X"),
        Box(730, 570, 220, 70, "Home switch", "closed while the carriage|is at home"),
    ]
    wires = [
        wire(POWER, (180, 85), (490, 85)),
        wire(POWER, (560, 50), (490, 50), (490, 222), (410, 222)),
        wire(POWER, (490, 140), (560, 140)),
        wire(POWER, (720, 50), (810, 50), label="3 phases", at=(735, 43)),
        wire(POWER, (720, 140), (810, 140), label="3 phases", at=(735, 133)),
        wire(POWER, (840, 276), (840, 464), label="4 wires", at=(848, 446)),
        wire(SIGNAL, (300, 254), (300, 365), (330, 365), label=pin["BATTERY"], at=(304, 360)),
        wire(SIGNAL, (560, 365), (590, 365), (590, 290), (530, 290), (530, 66), (560, 66),
             label=pin["SOURCE_ESC"], at=(566, 360)),
        wire(SIGNAL, (560, 395), (640, 395), (640, 170), label=pin["SUFFERER_ESC"], at=(566, 390)),
        wire(SIGNAL, (560, 425), (690, 425), (690, 355), (730, 355), label=pin["STEP"],
             at=(566, 420)),
        wire(SIGNAL, (560, 455), (706, 455), (706, 385), (730, 385), label=pin["DIRECTION"],
             at=(566, 450)),
        wire(SIGNAL, (560, 485), (676, 485), (676, 592), (730, 592), label=pin["HOME"],
             at=(566, 480)),
        wire(BUS, (220, 400), (330, 400), label="USB", at=(260, 394)),
        wire(BUS, (80, 460), (80, 570), label="header pins 1 (3.3 V), 3 (SDA),", at=(90, 505)),
        text(90, 520, "5 (SCL), 6 (GND)", size=11, colour=BUS),
        wire(GROUND, (560, 530), (600, 530), (600, 655), (300, 655), dashed=True,
             label="GND: one ground for UNO, battery's minus, ESCs' signals, stepper driver, home "
             "switch", at=(300, 672)),
    ]  # fmt: skip
    legend = [
        text(30, 24, "Power", colour=POWER, bold=True),
        text(90, 24, "signal", colour=SIGNAL, bold=True),
        text(150, 24, "USB and I²C", colour=BUS, bold=True),
        text(250, 24, "ground", colour=GROUND, bold=True),
    ]
    drawn = [*wires, *(box.svg() for box in boxes), *legend]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" '
        f'width="{_WIDTH}" height="{_HEIGHT}" font-family="sans-serif">\n'
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="white"/>\n'
        + "\n".join(drawn)
        + "\n</svg>\n"
    )


if __name__ == "__main__":
    (HERE / "wiring.svg").write_text(draw(pins(PINS.read_text("utf-8"))), encoding="utf-8")
