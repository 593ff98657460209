"""How sure an answer is: what it rests on, and what may look like it.

In: a `Result`. Out: sentences.
"""

import math

from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import Answer, Effect, Ranked, Result
from wakedeploy.gap.search.outcome import CHANCE
from wakedeploy.gap.systems.answers.advice import outweighs
from wakedeploy.gap.systems.answers.halves import repeated_answer
from wakedeploy.gap.systems.answers.importance import whole_percent
from wakedeploy.gap.systems.kinds.kind import Parameter
from wakedeploy.gap.systems.kinds.library import kinds_of
from wakedeploy.gap.wording import counted, listed, spoken

_MEANT = (0.0, -1.0, 1.0)  # bounds: no effect, and all of an input
_UNEVEN = 2.0  # times what even noise brings


def certainty(result: Result) -> str:
    """What the answer rests on."""
    if result.moved:
        return "Not before constants and units are known to be right."
    if result.verdict == "none" and nearest(result):
        return (
            "Less than usual: more than even noise acts, now and then or for long, and whether an "
            "effect or a disturbance these logs cannot tell."
        )
    if result.verdict == "none":
        return "Where nothing is missing, one search in twenty names something; this one did not."
    if result.effects and outweighs(result):
        return f"Not before units, signs and columns are known to be right. {_rest(result)}"
    beyond = "Where nothing is missing, fewer than one search in twenty finds something this clear."
    if result.is_outdone:
        return "It rests on forecasts of all blocks that were fitted, not on a search."
    if result.verdict == "unknown":
        evident = any(c.gain_nats > c.needed_nats for r in result.rounds for c in r.ranking)
        noise = "What is left is more than the sensors' noise, and lasts."
        return f"{beyond if evident else noise} What it is, is open."
    doubts = _at_its_end(result), _curved(result), _held_against(result), _rest(result)
    said = [beyond, _borne_out(result), repeated_answer(result), *doubts]
    return " ".join(sentence for sentence in said if sentence)


def _at_its_end(result: Result) -> str:
    """That a size went as far as the library lets it: the truth may lie beyond, or be another.

    Some ends mean something by themselves: no effect, an input of which nothing is left, and those
    at the readings' own, as of a sensor that is cut.
    """
    for effect in result.effects:
        for kind in kinds_of(effect.name):
            if kind.parameters and _is_at_its_end(kind.parameters[0], effect):
                return (
                    f"But the {spoken(kind.parameters[0].name)} of `{effect.name}` went as far as "
                    "an effect of the library may: it may be more than that, or something else "
                    "that looks like it."
                )
    return ""


def _is_at_its_end(parameter: Parameter, effect: Effect) -> bool:
    size = effect.parameters.get(parameter.name)
    if size is None or size.low == size.high or parameter.origin:
        return False
    at_top = size.value >= size.high and parameter.high not in _MEANT
    return at_top or (size.value <= size.low and parameter.low not in _MEANT)


def _held_against(result: Result) -> str:
    """For what an effect may stand that makes outputs answer inputs by far less; "" for others.

    A controller answers a force by its input, and nothing moves: as if the input did little.
    """
    name = min(result.answered, key=lambda name: result.answered[name], default="")
    if not name or result.answered[name] > RULES.far_less:
        return ""
    return (
        f"But with `{name}` inputs do {whole_percent(result.answered[name])} of what the system "
        "says: where a controller gives them, a force that stands in no column, and that it holds "
        "against, looks like that, too."
    )


def _rest(result: Result) -> str:
    """What is left beside names: a push that is most of what acts, more than noise, or ""."""
    push = max(result.unexplained, key=lambda push: push.share, default=None)
    if push is not None and push.share > RULES.unknown_push:
        return (
            f"Something else acts, too: a push on {push.state} of {whole_percent(push.share)} of "
            "its usual rate is left, which no effect that was tried explains."
        )
    return "" if result.white.after.passes else _more_than_noise(result)


def _more_than_noise(result: Result) -> str:
    """Of which output something is left that forecasts could still gain by; "" for a trifle."""
    foretold = dict(zip(result.gap, result.white.after.foretold(), strict=False))
    name, share = max(foretold.items(), key=lambda item: item[1])
    if 1.0 - math.sqrt(1.0 - share) <= RULES.error_trifle:
        return ""
    return (
        f"What is left of {name} is more than noise: its past foretells {whole_percent(share)} of "
        "it, so something else may be missing, too."
    )


def _curved(result: Result) -> str:
    """For what a name may stand; "" where no input that acts by a curve is near it."""
    if not result.curved:
        return ""
    return (
        f"But {listed(result.curved)} acts by a curve: what lags behind that, as a motor behind "
        "the square of its command, has no port, and what is named may stand for it."
    )


def _borne_out(result: Result) -> str:
    """What blocks kept apart say; of a class, that it is open."""
    if result.verdict == "class":
        return "Which of them it is, or whether several are, is open."
    fitted, sealed = len(result.episodes) - len(result.sealed), len(result.sealed)
    found = f"Found on {counted(fitted, 'block')} of the logs"
    apart = f"readings of {counted(sealed, 'block')} kept apart"
    if result.sealed_gain_nats > 0.0:
        return f"{found}; the {apart} bear it out."
    if any(
        error.after < (1.0 - RULES.error_trifle) * error.before for error in result.gap.values()
    ):
        return (
            f"{found}; forecasts get better by it, but the {apart}, asked one after another, do "
            "not confirm it: record more."
        )
    return f"{found}; the {apart} do not confirm it: record more."


def nearest(answer: Answer) -> Ranked | None:
    """The effect that would be evident, were noise as even as chance alone has it.

    None where anything but "nothing is missing" is answered, where the best gains no more than even
    noise brings, and where uneven noise brings little more than that.
    """
    if answer.verdict != "none" or not answer.rounds or not answer.rounds[0].ranking:
        return None
    first, best = answer.rounds[0], answer.rounds[0].ranking[0]
    is_uneven = best.needed_nats > _UNEVEN * first.steady_nats
    is_near = best.judged == CHANCE and best.gain_nats > first.steady_nats
    return best if is_near and is_uneven else None
