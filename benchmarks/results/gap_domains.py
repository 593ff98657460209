"""Results of the gap workflow on motors, fish, quadrotors and the 2D downwash."""

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.results.section import Records, Section, paragraphs, percent, table

Row = Mapping[str, Any]
DOMAINS = ("motor", "fish", "quadrotor", "downwash")


def domains(records: Records) -> Section:
    """What was named, in short; the whole is a page of its own."""
    rows = []
    for result in _results(records):
        named = ", ".join(effect["name"] for effect in result["effects"])
        for channel, residual in result["gap"].items():
            rows.append([result["domain"], named, channel, *_before_and_after(residual)])
    head = ["domain", "named", "channel", "residual before", "after"]
    return Section(
        "The gap workflow on other domains",
        "Effects that explain what a baseline lacks, on public recordings and on the simulated 2D "
        "downwash; residuals on sealed episodes, which took no part in finding the effects.",
        paragraphs(
            table(head, rows),
            "There are [rankings and intervals](gap-domains.md) for each.",
        ),
        (
            *(f"wakedeploy gap domain {name} PATH --out runs/{name}" for name in DOMAINS[:-1]),
            "wakedeploy gap domain downwash --out runs/downwash",
            *(f"python -m benchmarks.keep gap-domain runs/{name}" for name in DOMAINS),
        ),
    )


def page(records: Records) -> str:
    """Rankings, parameters and residuals of each domain, and what was measured beside them."""
    return paragraphs(
        "# The gap workflow on other domains",
        "Held-out gains are in nats. Brackets are 90 % intervals. Residuals are those of sealed "
        "episodes. [Other domains](../how-to/gap-domains.md) says how to make the tables again.",
        *(_domain(result) for result in _results(records)),
    )


def _results(records: Records) -> list[dict[str, Any]]:
    return [records.json(f"gap-domain-{name}.json") for name in DOMAINS]


def _before_and_after(residual: Row) -> list[str]:
    return [f"{residual[key]:.3g} {residual['unit']}" for key in ("before", "after")]


def _domain(result: Row) -> str:
    title = result["domain"].capitalize()
    parts = [f"## {title}", _found(result)]
    if "single_steps" in result:
        parts.append(_single_steps(result["single_steps"]))
    if "delay_profile" in result:
        parts += [_profile(result["delay_profile"]), _PROFILE_PICTURE]
    if "far" in result:
        parts += [_label(result["label"]["all"]), f"### {title} beyond 2 m", _found(result["far"])]
    return paragraphs(*parts)


def _found(result: Row) -> str:
    """The verdict, what each effect gains alone and beside those found, sizes, residuals."""
    placebo = result.get("placebo")
    channels = list(result["gap"])
    residuals = [
        [
            name,
            *_before_and_after(residual),
            f"{placebo['after'][channels.index(name)]:.3g} {residual['unit']}" if placebo else "–",
        ]
        for name, residual in result["gap"].items()
    ]
    instead = f"with {placebo['name']} instead" if placebo else "with another instead"
    return paragraphs(
        f"Verdict: {result['verdict']}, "
        f"{', '.join(effect['name'] for effect in result['effects'])}. "
        f"The threshold is {result['threshold_nats']:.1f} nats.",
        _rankings(result["rounds"]),
        table(["parameter", "value", "unit"], [_parameter(*size) for size in _sizes(result)]),
        table(["residual", "before", "after", instead], residuals),
    )


def _rankings(rounds: Sequence[Row]) -> str:
    """A column for each round: what each effect gains beside those that were found before."""
    gains = [{ranked["name"]: ranked["gain_nats"] for ranked in r["ranking"]} for r in rounds]
    head = ["effect", "alone", *(f"beside {', '.join(r['given'])}" for r in rounds[1:])]
    rows = [
        [name, *(f"{gain[name]:.0f}" if name in gain else "" for gain in gains)]
        for name in gains[0]
    ]
    return table(head, rows)


def _sizes(result: Row) -> list[tuple[str, Row]]:
    return list(result["parameters"].items())


def _parameter(name: str, estimate: Row) -> list[str]:
    return [
        name,
        f"{estimate['value']:.3g} [{estimate['low']:.3g}, {estimate['high']:.3g}]",
        estimate["unit"],
    ]


def _single_steps(step_fits: Row) -> str:
    up, down = (step_fits[way] for way in ("up", "down"))
    return (
        "An exponential fitted to each step alone has a median time constant of "
        f"{1e3 * up['median_s']:.1f} ms up ({up['steps']} steps) and "
        f"{1e3 * down['median_s']:.1f} ms down ({down['steps']} steps)."
    )


_PROFILE_PICTURE = "![Log-likelihood over the transport delay](../figures/gap-fish-delay.png)"


def _profile(profile: Row) -> str:
    """The likelihood over the transport delay at its summits, for the alias."""
    nats, delays = profile["nats"], profile["delay_s"]
    best = max(range(len(nats)), key=nats.__getitem__)
    shown = [i for i in range(len(nats)) if i % 3 == best % 3]
    return paragraphs(
        "Log-likelihood over the transport delay, with everything else refitted, in nats below the "
        "best. A delay half a flapping period from the best is an alias.",
        table(
            ["delay [s]", *(f"{delays[i]:.3f}" for i in shown)],
            [["nats", *(f"{nats[i] - nats[best]:.0f}" for i in shown)]],
        ),
    )


def _label(label: Row) -> str:
    """What is wrong with the quadrotors' force label, where no wake is."""
    turning = label["acceleration_less_derivative"]
    far, corrected = label["far_label_n"], label["far_corrected_n"]
    rows = [
        ["flights, seconds", f"{label['flights']}, {label['seconds']:.0f}"],
        ["slope of (a − dv/dt) on (ω × v), z axis", f"{turning['slope']:.3f}"],
        ["correlation", f"{turning['correlation']:.3f}"],
        ["difference, rms", f"{turning['rms_mps2']:.3f} m/s²"],
        ["what is left after adding ω × v", f"{turning['rms_left_mps2']:.3f} m/s²"],
        ["p, by random signs of blocks", f"{turning['p_value']:.4f}"],
        ["z label beyond 2 m, rms, as published", f"{far['rms'][2]:.2f} N"],
        ["the same, corrected", f"{corrected['rms'][2]:.2f} N"],
        ["z label beyond 2 m, largest, as published", f"{far['largest'][2]:.1f} N"],
        ["the same, corrected", f"{corrected['largest'][2]:.1f} N"],
        ["z label over all flights, rms, as published", f"{label['label_rms_n']:.2f} N"],
        ["the same, corrected", f"{label['corrected_rms_n']:.2f} N"],
        [
            "samples outside the range of the thrust fit",
            percent(label["outside_thrust_fit_share"], 1),
        ],
        ["largest difference from the file's label near a cut", f"{_near(label):.0f} N"],
    ]
    return paragraphs(
        "### The force label",
        "[What the workflow found in FlareDW's force label](../explanation/gap-quadrotor.md) "
        "explains these.",
        table(["", "measured"], rows),
    )


def _near(label: Row) -> float:
    return float(label["stated_label"]["near_cuts"])
