"""Results of the gap workflow on the public motions of a small arm."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.results.section import Records, Section, paragraphs, table
from wakedeploy.core import figures

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RECORD = "so101.json"
FIGURE = "so101"
Joint = Mapping[str, Any]
_REPLAYS = {
    "command": "the command itself",
    "plain": "fitted servo",
    "corrected": "with what was named",
}
_COLOURS = {
    "command": figures.LIMIT,
    "plain": figures.REFERENCE,
    "corrected": figures.PREDICTED,
}


def joints(records: Records) -> Section:
    """What each joint lacks, how large it is, and what replays of unseen motions gain."""
    record = records.json(RECORD)
    rows: Mapping[str, Joint] = record["joints"]
    head = ["joint", "lacks", "size", "cannot be told from", "motions", *_REPLAYS.values()]
    return Section(
        "A small arm, joint by joint",
        "The gap workflow on public motions of an SO-101, a servo of second order for each joint.",
        paragraphs(
            f"Searched on a minute of {' and of '.join(record['trained'])}; replayed on every "
            "other motion that moves the joint, from its first angle and its commands alone. Root "
            "mean square of measured less replayed, median over motions, in mrad (of the jaw in "
            "thousandths of its way). *Fitted servo* is a least-squares fit of its two constants "
            "to the replay, the usual first step.",
            table(head, [_line(name, row) for name, row in rows.items()]),
            "What gains most alone and was not named, with the reason:",
            table(
                ["joint", "effect", "gains", "why not"],
                [line for name, row in rows.items() for line in _turned_down(name, row)],
            ),
            "![A stretch of an unseen motion, and replay errors by "
            f"joint](../figures/{FIGURE}.png)",
        ),
        ("python -m benchmarks.so101 --json docs/records/so101.json",),
    )


def drawn(record: Mapping[str, Any]) -> "Figure":
    """A stretch of an unseen motion above, replay errors of all joints below."""
    with figures.style():
        picture, (above, below) = figures.figure(2, 1, size=(8.0, 5.6))
        shown = next(row["shown"] for row in record["joints"].values() if row["shown"])
        above.plot(shown["time_s"], shown["measured"], color=figures.MEASURED, lw=2.2,
                   label="measured")  # fmt: skip
        for name, label in _REPLAYS.items():
            above.plot(shown["time_s"], shown[name], color=_COLOURS[name], label=label,
                       ls=":" if name == "command" else "-")  # fmt: skip
        above.set(
            title="Elbow, a motion that took no part", xlabel="time [s]", ylabel="angle [rad]"
        )
        above.legend(ncols=4, loc="upper center", bbox_to_anchor=(0.5, -0.2))
        _bars(below, record["joints"])
    return picture


def _bars(panel: Any, rows: Mapping[str, Joint]) -> None:
    """Median replay errors; a dot for each motion."""
    for k, name in enumerate(_REPLAYS):
        for at, row in enumerate(rows.values()):
            errors = [1e3 * replay[name] for replay in row["replays"].values()]
            place = at + 0.26 * (k - 1)
            panel.bar(place, np.median(errors), 0.24, color=_COLOURS[name], alpha=0.5)
            panel.plot([place] * len(errors), errors, ".", ms=3, color=_COLOURS[name])
    panel.set_xticks(range(len(rows)), [name.replace("_", " ") for name in rows])
    panel.set(title="Replay errors on unseen motions: median, and each motion",
              ylabel="rms [mrad]", yscale="log")  # fmt: skip
    panel.grid(axis="x", visible=False)


def _line(name: str, row: Joint) -> list[str]:
    found = [e["name"] for e in row["effects"]]
    rivals = [r for r in row["class"] if r not in found]
    sizes = "; ".join(
        f"{p} {size['value']:.3g} [{size['low']:.3g}, {size['high']:.3g}] {size['unit']}"
        for effect in row["effects"]
        for p, size in effect["parameters"].items()
    )
    medians = [np.median([1e3 * m[k] for m in row["replays"].values()]) for k in _REPLAYS]
    said = {"none": "nothing that matters"}.get(str(row["verdict"]), str(row["verdict"]))
    return [
        name.replace("_", " "),
        ", ".join(found) or said,
        sizes or "–",
        ", ".join(rivals) or "–",
        str(len(row["replays"])),
        *(f"{value:.1f}" for value in medians),
    ]


def _turned_down(name: str, row: Joint) -> list[list[str]]:
    """The strongest candidates that were turned down."""
    found = {e["name"] for e in row["effects"]} | set(row["class"])
    turned = [
        ranked for ranked in row["leading"] if ranked["name"] not in found and ranked.get("judged")
    ]
    return [
        [
            name.replace("_", " "),
            ranked["name"],
            f"{ranked['gain_nats']:.0f} [{ranked['interval'][0]:.0f}, "
            f"{ranked['interval'][1]:.0f}] nats",
            "comes after another" if ranked["judged"] == "accepted" else ranked["judged"],
        ]
        for ranked in turned[:2]
    ]
