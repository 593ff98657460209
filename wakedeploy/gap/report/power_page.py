"""The page of `gap power`: what to read before flying, or before buying a sensor.

In: a `Power`. Out: figures as PNG, and one self-contained HTML page.
"""

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wakedeploy.core import figures, pages
from wakedeploy.core.files import write_text_whole
from wakedeploy.gap.report.phrases import plain
from wakedeploy.gap.report.power_charts import cost_chart, minutes_chart, sizes_chart
from wakedeploy.gap.rules import RULES
from wakedeploy.gap.systems.gantry.planning.power import EffectPower, Power
from wakedeploy.gap.systems.gantry.planning.sensors import SENSORS
from wakedeploy.gap.systems.gantry.planning.tracking import CONTROLLER
from wakedeploy.gap.wording import listed, minus, quantity

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SURELY = 0.95
KEPT, KEPT_OF = 0.82, 91  # measured: docs/records/gap-power.json
_WIDTH_IN = 7.5
_ROW_IN = 0.21
_NATS_LABELS = ["0.3", "1", "3", "10", "30", "100", "300"]
_MEANING = {
    "named": "named",
    "class": "found, but left in a class",
    "too small": "too small for these flights",
}
_COLOURS_SAY = "Green: named; orange: found, but left in a class; grey: too small."
_CAPTIONS = {
    "sizes": (
        "The smallest size of each effect that these flights detect (left end) and name (right "
        "end, the dot) four times in five, as a multiple of its plausible size. "
        f"{_COLOURS_SAY} Point at a row for its numbers."
    ),
    "sensors": (
        "How often each effect at its plausible size will be named, with no further sensor and "
        "with each of the menu. One is always, zero never."
    ),
    "confusion": (
        "Nats by which the best version of a rival (column) loses when an effect (row) is the "
        "truth. Dark cells are pairs that these flights cannot tell apart."
    ),
    "cost": (
        "What ignoring an effect of plausible size adds to the tracking error, and how long one "
        f"has to fly until it is named. {_COLOURS_SAY} Point at a row for its numbers."
    ),
}
_MUCH_IMITATED = 0.2  # of an effect's nats


def write_page(power: Power, folder: Path, rig: Path | None = None) -> Path:
    """Draw the figures into `folder`/figures and write `folder`/power.html; its path.

    `rig` is the rig file that was asked about, for the commands; None is the default rig.
    """
    drawn = {"sensors": draw_sensors(power), "confusion": draw_confusion(power)}
    pictures = {}
    for name, figure in drawn.items():
        path = folder / "figures" / f"power-{name}.png"
        figures.save(figure, path)
        pictures[name] = pages.Picture(path, _CAPTIONS[name])
    path = folder / "power.html"
    charts = {"sizes": [sizes_chart(power)], "cost": [cost_chart(power), minutes_chart(power)]}
    text = pages.page(
        "wakedeploy.gap.report", "power.html", pictures=pictures, charts=charts,
        captions=_CAPTIONS, **_contents(power, rig),
    )  # fmt: skip
    write_text_whole(path, text)
    return path


def sentences(power: Power) -> list[str]:
    """The answer in plain words."""
    count = {v: sum(e.verdict == v for e in power.effects) for v in _MEANING}
    sentences = [
        f"With {power.flights} flights of {power.seconds:g} s, {count['named']} of "
        f"{len(power.effects)} effects of plausible size will be named, {count['class']} will be "
        f"found but left in a class, and {count['too small']} are too small to be sure of."
    ]
    for group in power.classes:
        members = listed([plain(name) for name in group])
        sentences.append(f"Together in a class: {members}.")
    bought = power.purchase
    if bought is None:
        sentences.append("No sensor of the menu would name another effect.")
    else:
        sensor, gained = bought
        sentences.append(
            f"The sensor that helps most is the {sensor.name} ({sensor.description}, about "
            f"{sensor.euros:.0f} €): it names {listed(gained)} as well. The search does not "
            "read it yet: what it reads is for you to hold against the class."
        )
    costly = max(power.effects, key=lambda e: e.cost_mm if e.cost_mm is not None else np.inf)
    cost = (
        "ends the flight in a failsafe"
        if costly.cost_mm is None
        else (f"adds {costly.cost_mm:.0f} mm to a tracking error of {power.tracking_mm:.1f} mm")
    )
    sentences.append(f"What costs most to ignore: {plain(costly.name)}. It {cost}.")
    return sentences + _imitated(power)


def _imitated(power: Power) -> list[str]:
    """Effects of which the model's own form takes much: their gains are what is left."""
    lost = [e for e in power.effects if e.lost_to_form > _MUCH_IMITATED]
    if not lost:
        return []
    shares = [f"{e.name} {100 * e.lost_to_form:.0f} %" for e in lost]
    return [
        "How far the form of the wake and of the friction may be off ([discrepancy] in the rig "
        f"file) costs evidence, since it can look like an effect: {', '.join(shares)}."
    ]


def rows(power: Power) -> list[list[str]]:
    """One row per effect, for the terminal and for the page; see `COLUMNS`."""
    return [
        [
            e.name,
            _amount(e.size, e.unit),
            _amount(e.detectable, e.unit),
            _amount(e.nameable, e.unit),
            _MEANING[e.verdict] if e.verdict != "class" else f"class with {listed(e.rivals)}",
            "never" if e.minutes is None else f"{e.minutes:.1f}",
            _advice(e),
            "fails" if e.cost_mm is None else minus(f"{e.cost_mm:+.1f}"),
        ]
        for e in power.effects
    ]


COLUMNS = (
    "effect",
    "plausible size",
    "detected from",
    "named from",
    "from these flights",
    "minutes to name",
    "what would help",
    "costs mm",
)


def _advice(e: EffectPower) -> str:
    if e.verdict == "named":
        return "nothing needed"
    if e.sensor is not None:
        return e.sensor
    if e.calibrate_to is not None:
        return f"calibrate to ± {_amount(e.calibrate_to, e.unit)}"
    return "more flights" if e.minutes is not None else "no sensor of the menu"


def _amount(value: float | None, unit: str) -> str:
    if value is None:
        return "never"
    text = minus(f"{value:.2g}")
    return text if unit == "1" else f"{text} {unit}"


def draw_sensors(power: Power) -> "Figure":
    """Naming rate without and with each sensor."""
    names = ["none", *(s.name for s in SENSORS)]
    with figures.style():
        count = len(power.effects)
        drawn, axes = figures.figure(size=(_WIDTH_IN, 1.4 + _ROW_IN * count))
        axes.set_yticks(range(count), power.names, fontsize=7.5)
        axes.imshow(power.named_with, cmap="YlGn", vmin=0.0, vmax=1.15, aspect="auto")
        for y, shares in enumerate(power.named_with):
            for x, share in enumerate(shares):
                weight = "bold" if share >= RULES.sure_share else "normal"
                axes.text(x, y, f"{share:.2f}", ha="center", va="center", fontsize=7, weight=weight)
        axes.set_xticks(range(len(names)), names, rotation=30, ha="left")
        axes.xaxis.tick_top()
        axes.grid(False)
    return drawn


def draw_confusion(power: Power) -> "Figure":
    """Nats that every rival loses, on a logarithmic scale of colours."""
    from matplotlib.colors import LogNorm

    count = len(power.effects)
    with figures.style():
        drawn, axes = figures.figure(size=(_WIDTH_IN, 6.4))
        loss = np.clip(power.loss_nats, 0.3, 300.0)
        shown = np.where(np.eye(count, dtype=bool), np.nan, loss)
        image = axes.imshow(shown, cmap="magma", norm=LogNorm(0.3, 300.0))
        axes.set_xticks(range(count), power.names, rotation=90, fontsize=6.5)
        axes.set_yticks(range(count), power.names, fontsize=6.5)
        axes.grid(False)
        axes.set_xlabel("rival")
        axes.set_ylabel("truth")
        bar = drawn.colorbar(image, ax=axes, fraction=0.04, extend="both")
        bar.set_ticks([0.3, 1, 3, 10, 30, 100, 300], labels=_NATS_LABELS)
        bar.ax.axhline(RULES.class_nats, color="#ffffff", linewidth=1.2)
        bar.set_label("nats lost by the rival (line: enough to name)")
    return drawn


def next_step(power: Power, rig: Path | None) -> tuple[str, list[str]]:
    """What to do before flying, or that flying will do; why, and commands to copy."""
    given = f" --rig {'rig.toml' if rig is None else shlex.quote(str(rig))}"
    first = ["wakedeploy rig init rig.toml"] if rig is None else []
    if power.classes:
        members = " ".join(f"--class {name}" for name in power.classes[0])
        return (
            "Next step: look for the manoeuvre that tells a class apart, and fly it with the "
            "others.",
            [*first, f"wakedeploy gap plan{given} {members} --write-reference manoeuvre.csv"],
        )
    if not any(each.verdict == "named" for each in power.effects):
        more = f"--flights {2 * power.flights} --seconds {power.seconds:g}"
        return (
            "Next step: ask what more flights would tell, before flying any.",
            [*first, f"wakedeploy gap power{given} {more}"],
        )
    fly = f"--port /dev/ttyACM0 --seconds {power.seconds:g} --seed 1 --log flights"
    return (
        f"Next step: fly {power.flights} of these, each with another seed, and ask what is "
        "missing.",
        [
            *first,
            f"wakedeploy run-gantry --baseline{given} {fly}",
            f"wakedeploy gap close{given} --measured flights/*.mcap --out gap",
        ],
    )


def _tiles(power: Power) -> list[tuple[str, str]]:
    count = {v: sum(e.verdict == v for e in power.effects) for v in _MEANING}
    return [
        ("effects asked about", str(len(power.effects))),
        *((_MEANING[v], str(count[v])) for v in _MEANING),
        ("tracking error without any of them", quantity(1e-3 * power.tracking_mm, "m")),
    ]


def _contents(power: Power, rig: Path | None) -> dict[str, Any]:
    """What the page says."""
    sensors = ["sensor", "what it is", "noise", "gain known to", "about"]
    classes = ["class", "cheapest sensor that names each", "what splits it"]
    return {
        "title": "What these flights can tell",
        "subtitle": _subtitle(power),
        "sentences": sentences(power),
        "tile_pairs": _tiles(power),
        "next": next_step(power, rig),
        "effects": pages.Table(COLUMNS, rows(power)),
        "sensors": pages.Table(sensors, _sensor_rows()),
        "classes": pages.Table(classes, _class_rows(power)),
        "flown": f"Flown by {CONTROLLER}; the rig file does not know the effect, the plant has it. "
        f"Without any effect the error is {power.tracking_mm:.1f} mm.",
        "method": _method(power),
    }


def _subtitle(power: Power) -> str:
    minutes = power.flights * power.flight_s / 60.0
    return (
        f"{power.flights} flights of {power.seconds:g} s ({minutes:.1f} minutes with rests) of the "
        f"rig {power.rig_sha256[:12]}, simulated; nothing was measured."
    )


def _sensor_rows() -> list[list[str]]:
    return [
        [
            s.name,
            s.description,
            _amount(s.noise, s.unit),
            f"{100 * s.gain_sd:g} %",
            f"{s.euros:g} €",
        ]
        for s in SENSORS
    ]


def _class_rows(power: Power) -> list[list[str]]:
    known = {e.name: e for e in power.effects}
    sentences = []
    for group in power.classes:
        sensor = power.splitter(group)
        price = "none of these" if sensor is None else f"{sensor.name}, {sensor.euros:g} €"
        ways = "; ".join(dict.fromkeys(known[n].split_by for n in group))
        sentences.append([", ".join(group), price, ways])
    return sentences


def _method(power: Power) -> tuple[str, ...]:
    return (
        "Flights of the rig file are simulated closed loop, with turbulence, outliers and clock "
        "jitter. The likelihood that names effects from measured flights then tells how each "
        "effect, at its plausible size (one prior scale of the library), would move the range "
        "sensor's innovations, and how much of that noise, calibration and each rival explain.",
        f"An effect is detected when its gain on flights left out crosses "
        f"{power.threshold_nats:.1f} nats, which less than one data set in twenty without any "
        f"effect does (from {power.threshold_source}). It is named when every rival is more than "
        f"{RULES.class_nats:g} nats behind on all flights; both must happen in "
        f"{100 * RULES.sure_share:.0f} % of the data sets, which takes about "
        f"{RULES.margin_nats:.1f} nats on average. Flights that the workflow seals, two of seven, "
        "take no part in naming.",
        f"Believe a promise of {100 * SURELY:.0f} % and more as {100 * KEPT:.0f} %: of "
        f"{KEPT_OF} effects hidden in the gap benchmark of which that was promised, so many were "
        "named. Flights are not as linear as this is.",
        "Effects that only move a constant of the rig file count from where calibration leaves "
        "that constant: within about three of its stated spreads no number of flights names them, "
        "but a better calibration does; to what spread is said in the table.",
        "Sensors are emulated: how their reading changes with every effect comes from the forces "
        "along the simulated flights; noise, gain and price are assumptions, listed above. Their "
        "zero is taken as unknown in every flight.",
        "All this is linear in the size of an effect. An effect that leaves its mark only where it "
        "acts, as held readings do, is judged on flights that do not have it yet, and will be told "
        "apart better than is said here.",
    )
