"""What reference flights have shown, as JSON and in words.

In: a `Reference`. Out: `reference.json`'s content, and sentences with sizes and p-values.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from wakedeploy.gap.systems.gantry.reference.corrected import constants_learned, form_force_n
from wakedeploy.gap.systems.gantry.reference.learning import Odd, Own, Reference
from wakedeploy.gap.systems.gantry.search.answer import sizes_of
from wakedeploy.gap.systems.gantry.varying import SAG, Varying

_PERCENT, _MM = (100.0, "%"), (1e3, "mm")
_SCALES = {"thrust.sufferer.scale": _PERCENT, SAG: (100.0, "%/s"), "range.bias_m": _MM}
_MOVED_SD = 1.0  # a constant that moved by less is where the rig file has it


def as_json(reference: Reference) -> dict[str, Any]:
    """All that was learned, sizes in SI units."""
    names = [flight.name for flight in reference.flights]
    return {
        "flights": names,
        "learned_from": [names[i] for i in reference.kept],
        "repeatability": [_variation_as_json(quantity, names) for quantity in reference.variations],
        "odd": [
            {
                "flight": names[o.flight],
                "quantity": o.quantity.name,
                "away": o.away,
                "unit": o.quantity.unit,
                "p_value": o.p_value,
            }
            for o in reference.odd
        ],
        "constants": [constant.as_json() for constant in constants_learned(reference)],
        "effects": {
            name: {p: size.model_dump() for p, size in sizes_of(reference.fit, name).items()}
            for name in reference.fit.hypothesis
        },
        "form_force_n": form_force_n(reference),
        "sentences": sentences(reference),
    }


def _variation_as_json(learned: Own, names: Sequence[str]) -> dict[str, Any]:
    values = zip(names, learned.values, learned.errors, strict=True)
    return {
        "quantity": learned.quantity.name,
        "unit": learned.quantity.unit,
        "sd": learned.between.sd,
        "low": learned.between.low,
        "high": learned.between.high,
        "p_value": learned.between.p_value,
        "by_flight": {n: {"value": float(v), "error": float(e)} for n, v, e in values},
    }


def sentences(reference: Reference) -> list[str]:
    """The same in plain words, with the flights that are unlike the others first."""
    lines = [_odd(odd, Path(reference.flights[odd.flight].name).name) for odd in reference.odd]
    lines += [_variation(quantity) for quantity in reference.variations]
    for name in reference.fit.hypothesis:
        for parameter, size in sizes_of(reference.fit, name).items():
            ends = f"[{size.low:.3g}, {size.high:.3g}]"
            lines.append(f"{name}: {parameter} {size.value:.3g} {size.unit} {ends}.")
    moved = [
        f"{c.name} {c.stated:.4g} → {c.value:.4g} ± {c.spread:.2g}"
        for c in constants_learned(reference)
        if abs(c.value - c.stated) > _MOVED_SD * c.stated_spread
    ]
    if moved:
        lines.append(f"Constants beyond the rig file's spread: {'; '.join(moved)}.")
    mn = 1e3 * form_force_n(reference)
    lines.append(f"The form of wake and friction differs from the model's by {mn:.0f} mN rms.")
    return lines


def _odd(odd: Odd, flight: str) -> str:
    size = _size(odd.quantity, abs(odd.away))
    way = "more" if odd.away > 0.0 else "less"
    return (
        f"{flight} differs from the others: {odd.quantity.words} is {size} {way}"
        f" (p = {odd.p_value:.1g}). Nothing was learned from it."
    )


def _variation(learned: Own) -> str:
    words = learned.quantity.words
    if not learned.between.is_sure:
        most = _size(learned.quantity, learned.between.high)
        return f"From flight to flight {words} stays the same, to within {most}."
    low, high = (
        _size(learned.quantity, learned.between.low),
        _size(learned.quantity, learned.between.high),
    )
    sd = _size(learned.quantity, learned.between.sd)
    return f"From flight to flight {words} varies by {sd} (1 sd) [{low}, {high}]."


def _size(quantity: Varying, value: float) -> str:
    factor, unit = _SCALES[quantity.name]
    return f"{factor * value:.2g} {unit}"
