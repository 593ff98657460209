"""Whether what was named matters: which outputs are forecast better by it, and which worse.

In: a `Result`. Out: sentences and phrases for a terminal and a page.
"""

import math
from collections.abc import Sequence

from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import Answer, Effect, Error, Forecast, Result
from wakedeploy.gap.wording import UNKNOWN, listed, percent, quantity

_MOST_NAMED = 3
_FAR_BEYOND = 10.0  # times a sensor's noise
_NOTHING = 0.005  # of a share, which is printed in whole percent

OutputError = tuple[str, Error]


def importance(result: Result) -> str:
    """How far off forecasts are, and how far with what was found."""
    ahead = "orecasts"
    if result.forecast_s is not None:
        ahead += f" {quantity(result.forecast_s, 's')} ahead"
    if result.effects:
        return _with_effects(result, f"{ahead} of blocks kept apart")
    errors = [f"{name} by {quantity(e.before, e.unit)}" for name, e in result.gap.items()]
    off = f"F{ahead} of blocks kept apart are off: {listed(errors)}"
    if result.verdict == "none":
        answer = (
            "Of what was tried, nothing does" if result.unexplained and not result.moved else "No"
        )
        return f"{answer}. {off}, and no effect makes that clearly smaller.{_beyond_noise(result)}"
    return f"{off}. Whether that is much, you know best."


def _beyond_noise(result: Result) -> str:
    """That forecasts err far more than a sensor, which "nothing is missing" may hide; or ""."""
    ratios = {
        name: error.before / noise.value
        for name, error in result.gap.items()
        if (noise := result.noise.get(f"noise.{name}")) is not None and noise.value > 0.0
    }
    most = max(ratios, key=lambda name: ratios[name], default=None)
    if most is None or not ratios[most] > _FAR_BEYOND:
        return ""
    return (
        f" That is {ratios[most]:.0f} times what the sensor of {most} errs: as in a system that "
        "lets small errors grow, under a disturbance, or where something acts that no port offers."
    )


def removed_of(answer: Answer, effect: Effect) -> str:
    """`removes 62 % … of the squared forecast error`: of several outputs, the one that gains most.

    The search weighs outputs alike, each by what it errs without the effect. So an output that no
    effect can touch halves the share of one that is mended wholly.
    """
    share = removed_words(effect.forecast)
    gap = answer.gap if isinstance(answer, Result) else {}
    count = len(gap or {name.split(".")[1] for name in answer.noise})
    where = "where it was not fitted"
    if count < 2:
        return f"removes {share} of the squared forecast error {where}"
    mean = f"as a mean over the {count} outputs"
    best = min(gap.items(), key=lambda each: _remaining(each[1]), default=None)
    if best is None or len(answer.effects) > 1 or not _remaining(best[1]) < 1.0:
        return f"removes {share} of the squared forecast error {where}, {mean}"
    name, gone = best[0], whole_percent(1.0 - _remaining(best[1]) ** 2)
    return (
        f"removes {gone} of the squared forecast error of {name} on blocks kept apart; {mean} "
        f"{share} {where}"
    )


def by_output(result: Result) -> list[str]:
    """Each output's forecast error before and after; of several outputs, also its change."""
    if not result.effects:
        return [
            f"{name}: rms forecast error {quantity(error.before, error.unit)}"
            for name, error in result.gap.items()
        ]
    return [f"{name}: {_both(error)}{_gone(result, error)}" for name, error in result.gap.items()]


def _both(error: Error) -> str:
    before, after = (quantity(each, error.unit) for each in (error.before, error.after))
    return f"rms forecast error {before} before, {after} after"


def _gone(result: Result, error: Error) -> str:
    gone = 1.0 - _remaining(error) ** 2
    if len(result.gap) < 2 or not math.isfinite(gone):
        return ""
    if abs(gone) < _NOTHING:
        return "; its square stays"
    return f"; its square {'falls' if gone > 0.0 else 'grows'} by {whole_percent(abs(gone))}"


def removed_words(removed: Forecast) -> str:
    """`62 % (58 % to 66 %)` of an error; an interval that rounds to that is left out."""
    low, middle, high = (whole_percent(s) for s in (removed.low, removed.share, removed.high))
    interval = f" ({low} to {high})" if {low, high} - {middle, UNKNOWN} else ""
    return f"{middle}{interval}"


def whole_percent(share: float) -> str:
    """A share in whole percent; what is not all of it never reads as all of it."""
    return "over 99 %" if 0.99 < share < 1.0 else percent(share)


def _with_effects(result: Result, forecasts: str) -> str:
    """Outputs that gain, outputs that lose, and that there are others."""
    by_gain = sorted(result.gap.items(), key=lambda each: _remaining(each[1]))
    known = [(name, error) for name, error in by_gain if not math.isnan(_remaining(error))]
    better = [each for each in known if _remaining(each[1]) < 1.0 - RULES.error_trifle]
    worse = [each for each in reversed(known) if _remaining(each[1]) > 1.0 + RULES.error_trifle]
    names = [f"`{effect.name}`" for effect in result.effects]
    by = "it" if result.verdict == "named" and len(names) == 1 else listed(names)
    if known and not better and not worse:
        return f"Hardly. With {by}, f{forecasts} change by a trifle: {_first(known)}."
    said = f"F{forecasts} get no better with {by}."
    if better:
        said = f"Yes. With {by}, f{forecasts} are off by less: {_each(better)}."
    said += _worse(worse)
    return f"{said} The others hardly change." if len(known) > len(better + worse) else said


def _worse(errors: Sequence[OutputError]) -> str:
    """What is said of outputs that are forecast worse; "" for none."""
    if not errors:
        return ""
    if len(errors) > 1:
        return f" These get worse: {_each(errors)}."
    return f" {errors[0][0]} gets worse: off by {_instead(errors[0][1])}."


def _first(errors: Sequence[OutputError]) -> str:
    name, error = errors[0]
    return f"{name} is off by {_instead(error)}"


def _remaining(error: Error) -> float:
    """The share of an error that is left; 1 of one that was 0 and stays so."""
    if error.before == 0.0:
        return 1.0 if error.after == 0.0 else math.inf
    return error.after / error.before


def _each(errors: Sequence[OutputError]) -> str:
    """The clearest of some outputs, and how many more there are."""
    named = [f"{name} by {_instead(error)}" for name, error in errors[:_MOST_NAMED]]
    more = len(errors) - len(named)
    return listed([*named, f"{more} more"] if more else named)


def _instead(error: Error) -> str:
    return f"{quantity(error.after, error.unit)} instead of {quantity(error.before, error.unit)}"
