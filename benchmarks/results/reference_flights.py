"""Results of reference flights: a form that is evident no more, and spreads that were known."""

from benchmarks.results.section import Records, Section, paragraphs, table, within

RECORD = "reference-flights.json"
_UNITS = {  # factor, unit, decimals
    "thrust.sufferer.scale": (100.0, "%", 2),
    "battery-sag": (100.0, "%/s", 3),
    "range.bias_m": (1000.0, "mm", 1),
}


def learned(records: Records) -> Section:
    """What seven ordinary flights teach about a rig."""
    record = records.json(RECORD)
    sets = [spread_set for name, spread_set in record.items() if name.startswith("set")]
    before, after, form = record["before"], record["after"], record["form"]
    evident = [
        ["nats for another form", f"{before['form_nats']:.1f}", f"{after['form_nats']:.1f}"],
        [
            "nats of the best of some eighty terms, promised",
            f"{before['best_term_nats']:.1f} ({before['best_term']})",
            f"{after['best_term_nats']:.1f} ({after['best_term']})",
        ],
        [
            "forecast error 1 s ahead",
            *(f"{1e3 * evidence['forecast_m']:.1f} mm" for evidence in (before, after)),
        ],
    ]
    spreads = [_spread(quantity) for each in sets for quantity in each["quantities"]]
    odd = [odd for each in sets for odd in each["odd"]]
    flagged = sum(flight == 3 for flight, *_ in odd)
    shares = f"{100 * form['misfit_share']:.1f} % ({1e3 * form['misfit_n']:.0f} mN)"
    return Section(
        "Reference flights",
        f"A gantry whose jet has another form, {shares} off: how evident that is on five further "
        "flights, under the rig file as it was and under the one that `gap reference` made of "
        "seven. Then sets of seven flights whose thrust, battery and bias were drawn for each "
        "flight, the fourth with a bias of 30 mm. Brackets: 90 % intervals.",
        paragraphs(
            table(["", "before", "after"], evident),
            table(["what varies from flight to flight", "true", "found"], spreads),
            f"The fourth flight was called odd in {flagged} of {len(sets)} sets, another one "
            f"{len(odd) - flagged} times.",
        ),
        ("python -m benchmarks.reference_flights --sets 2 --out build/reference-flights --record",),
    )


def _spread(quantity: dict[str, float | str]) -> list[str]:
    factor, unit, decimals = _UNITS[str(quantity["quantity"])]
    sd, low, high = (float(quantity[key]) for key in ("sd", "low", "high"))
    true = factor * float(quantity["true_sd"])
    found = within(sd, low, high, decimals, factor)
    return [str(quantity["quantity"]), f"{true:.{decimals}f} {unit}", f"{found} {unit}"]
