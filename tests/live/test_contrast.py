"""The pages' colours can be read: contrast by WCAG 2.2, in both schemes, from the style sheet."""

import re
from pathlib import Path

import pytest

import wakedeploy.live
from wakedeploy.core.pages import text_file

BASE = (Path(wakedeploy.live.__file__).parent / "static" / "base.css").read_text("utf-8")
(LIGHT, DARK), (MORE_LIGHT, MORE_DARK) = (
    [
        dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6});", block))
        for block in re.findall(r":root \{(.*?)\n\s*\}", sheet.split("@media print")[0], re.DOTALL)
    ]
    for sheet in (text_file("look.css"), BASE)
)
LIGHT, DARK = LIGHT | MORE_LIGHT, DARK | MORE_DARK
TEXT = [("ink", "ground"), ("ink", "card"), ("soft", "ground"), ("soft", "card"), ("soft", "sunk"),
        ("accent", "card"), ("accent", "ground"), ("on-accent", "accent"), ("on-stop", "stop"),
        ("on-stop", "stop-deep"), ("ink", "sunk"), ("accent", "sunk"), ("alarm", "card"),
        ("second", "card")]  # fmt: skip
TEXT += [("on-mode", name) for name in LIGHT if name.startswith("mode-")]
LINES = [("reference", "card"), ("predicted", "card"), ("accent", "card"), ("stop", "ground"),
         ("soft", "card")]  # fmt: skip


def luminance(colour):
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one, other):
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def test_the_formula_is_wcags():
    assert contrast("#000000", "#ffffff") == pytest.approx(21.0)
    assert contrast("#777777", "#ffffff") == pytest.approx(4.48, abs=0.005)


@pytest.mark.parametrize("scheme", [LIGHT, LIGHT | DARK], ids=["light", "dark"])
def test_text_has_four_and_a_half_and_lines_three(scheme):
    told = {f"{a} on {b}": contrast(scheme[a], scheme[b]) for a, b in TEXT}
    assert {pair: round(ratio, 2) for pair, ratio in told.items() if ratio < 4.5} == {}
    told = {f"{a} on {b}": contrast(scheme[a], scheme[b]) for a, b in LINES}
    assert {pair: round(ratio, 2) for pair, ratio in told.items() if ratio < 3.0} == {}
