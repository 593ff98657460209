"""What a step found in a user's system, as sentences for a terminal.

The verdict and three answers come first, for which nobody needs statistics: does it matter, how
sure is that, what next. The numbers stand below them. A page shows the same first screen, tables in
the place of the numbers, and the remarks.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from wakedeploy.gap.search.artefacts import (
    Answer,
    Artefact,
    Disagreements,
    Effect,
    Forecast,
    Leftover,
    Measured,
    Result,
    Size,
)
from wakedeploy.gap.search.outcome import ACCEPTED, CHANCE, OUTDONE, SUPERFLUOUS, UNSEEN_WORSE
from wakedeploy.gap.systems.answers.advice import (
    more_than_named,
    over,
    own_law,
    pushes_left,
    rest_words,
    units_first,
    unknown_step,
)
from wakedeploy.gap.systems.answers.calibration import constant_words, moved_words, told_otherwise
from wakedeploy.gap.systems.answers.certainty import certainty, nearest
from wakedeploy.gap.systems.answers.halves import repeated_sentences
from wakedeploy.gap.systems.answers.importance import (
    by_output,
    importance,
    removed_of,
    removed_words,
    whole_percent,
)
from wakedeploy.gap.systems.answers.reader_units import as_read
from wakedeploy.gap.systems.kinds.library import plain
from wakedeploy.gap.wording import (
    DETAILS,
    behind,
    listed,
    measured,
    minus,
    nats,
    quantity,
    spoken,
)

if TYPE_CHECKING:
    from wakedeploy.gap.systems.planning.planned import Planned

FURTHER_LOG = "new"  # stands in commands for a log that was not searched
_MOST_PLACES, _MOST_RANKED = 6, 5
_FAR_AHEAD = (
    "Found where the system predicts far ahead, from a few readings a forecast; from the next "
    "reading alone came no such answer."
)


def sentences(artefact: Artefact, planned: "Planned | None" = None) -> list[str]:
    """The lines that a command prints; `planned` is what a plan for its class came to."""
    if isinstance(artefact, Disagreements) and not isinstance(artefact, Result):
        return _found(artefact)
    assert isinstance(artefact, Answer)
    detail = [*_effects(artefact), *(f"  {remark}" for remark in remarks(artefact))]
    if not isinstance(artefact, Result):
        return [*_verdict(artefact), *detail]
    detail += [f"  {line}" for line in by_output(artefact)]
    detail += [f"  {line}" for line in constant_words(artefact)]
    return [*first_screen(artefact, planned), *([DETAILS] if detail else []), *detail]


def added_sentences(artefact: Artefact, names: Sequence[str]) -> list[str]:
    """What was added because a person asked for it: its size, and all that was fitted beside it."""
    assert isinstance(artefact, Answer)
    return [
        f"Added as you asked: {listed([*dict.fromkeys(names)])}. The correction has:",
        *(f"  {effect.name}: {_sizes(effect)}." for effect in artefact.effects),
        *(f"  {shifted_words(inputs, by)}" for inputs, by in artefact.shifted_together),
        *(f"  {line}" for line in constant_words(artefact)),
    ]


def first_screen(result: Result, planned: "Planned | None" = None) -> list[str]:
    """The verdict, and three answers."""
    return [
        *_verdict(result),
        f"Does it matter? {importance(result)}",
        f"How sure is that? {certainty(result)}",
        f"What next? {next_step(result, planned)}",
    ]


def remarks(answer: Answer) -> list[str]:
    """What stands in no table.

    That is: what each half of the logs says, fits that were stopped, what is left, and what was not
    named and why, or came nearest to being evident.
    """
    far = [_FAR_AHEAD] if answer.is_far_ahead else []
    far += [
        f"`{name}` is one sample. A controller that logs its readings and the command that follows "
        "them in one row makes an output that shows the command directly so late: then nothing is "
        "missing there, and the output's column wants shift_s of minus a sample."
        for name in answer.late_by_a_row
    ]
    return [
        *far,
        *repeated_sentences(answer),
        *(shifted_words(inputs, by) for inputs, by in answer.shifted_together),
        *_unsettled(answer),
        *_unexplained(answer),
        *_nearest(answer),
        *_rejected(answer),
    ]


def shifted_words(inputs: Sequence[str], by: Measured) -> str:
    """How late inputs of one clock act by its stamps, and that it may be a delay."""
    way = "after" if by.value > 0.0 else "before"
    low, high = sorted((abs(by.low), abs(by.high)))
    delay = " If the stamps are right, that is a delay of the system." if by.value > 0.0 else ""
    size = measured(abs(by.value), low, high, by.unit)
    verb, whose = ("acts", "its") if len(inputs) == 1 else ("act", "their")
    return (
        f"{listed(inputs)} {verb} {size} {way} {whose} stamps, which the "
        "fit took for the log's clock; the "
        f"correction has it as clocks_s.{delay}"
    )


def _found(disagreements: Disagreements) -> list[str]:
    places = disagreements.where
    if not places:
        return [
            "No place stands out where the system and its logs disagree. What is missing everywhere"
            " alike, as a delay, shows in none: the next step, `name`, asks for it."
        ]
    lines = [f"They disagree in {len(places)} places; the clearest:"]
    for p in places[:_MOST_PLACES]:
        lines.append(
            f"  {p.channel}: {_signed(p.residual)}{behind(p.unit)} where {p.coordinate} is "
            f"{minus(f'{p.low:.3g} to {p.high:.3g}')}{behind(p.coordinate_unit)}"
        )
    return lines


def _verdict(answer: Answer) -> list[str]:
    """What the system lacks; before it, what speaks against any answer."""
    return [*late_words(answer.late), *moved_words(answer), _lacking(answer)]


def _lacking(answer: Answer) -> str:
    if answer.verdict == "class":
        return f"The system lacks {lacking_of_class(answer)}. The logs cannot say which."
    if answer.verdict == "named":
        named = listed([plain(e.name) for e in answer.effects])
        return f"The system lacks {named}.{rest_words(answer)}"
    if answer.verdict == "none":
        if answer.moved:
            return "With that, nothing else that matters is missing from the system."
        if answer.unexplained:
            return f"No effect that was tried is missing from the system.{pushes_left(answer)}"
        return "Nothing that matters is missing from the system."
    if answer.is_outdone:
        return (
            "The system forecasts no better than its outputs' last readings or their means: its "
            "equations are wrong by more than an effect, or these logs hardly move it."
        )
    if answer.rivals:
        rivals = listed([plain(name) for name in answer.rivals])
        return f"Something is missing; these explain it about as well: {rivals}."
    return "Something acts on the system that no known effect explains."


def lacking_of_class(answer: Answer) -> str:
    """What is sure beside a class, and the class: "dry friction …, and one of these: …"."""
    sure = [plain(e.name) for e in answer.effects if e.name not in answer.rivals]
    rivals = f"one of these: {listed([plain(name) for name in answer.rivals], 'or')}"
    return f"{listed(sure)}, and {rivals}" if sure else rivals


def next_step(result: Result, planned: "Planned | None" = None) -> str:
    """What to do; the commands stand below."""
    doubt, step = units_first(result), _by_verdict(result, planned)
    return f"{doubt} {step[0].lower()}{step[1:]}" if doubt else step


def _by_verdict(result: Result, planned: "Planned | None") -> str:
    """What to do where the logs' columns are right."""
    if result.moved:
        return (
            "Check what was moved, and the units of columns.toml: `gap check` prints the range of "
            "each column in the system's unit."
        )
    if result.curved:
        return (
            f"State what the law makes of {listed(result.curved)} as an input of its own, Input(…, "
            "law=…), with a port, and ask again."
        )
    if result.verdict == "class":
        return _open_class(result, planned)
    if result.effects and result.verdict == "named":
        return more_than_named(result) or (
            "Replay a log that took no part with the correction, then use the corrected system. In "
            f"the command below that log is called {FURTHER_LOG}."
        )
    if result.is_outdone:
        return (
            "Check equations, units and signs: see what each constant moves. If the outputs stay "
            "nearly where they are, record logs in which they move more."
        )
    if result.verdict == "unknown":
        return unknown_step(result)
    use = "Use the system as it is."
    if otherwise := [f"`{name}`" for name in told_otherwise(result)]:
        use = (
            f"State what was fitted for {listed(otherwise)}, which the logs know better, and use "
            "the system."
        )
    first = []
    if near := nearest(result):
        more = f"Record more of the moments in which {plain(near.name)} would act"
        first.append(f"{more}, and ask again with that log, too.")
    if result.unexplained:
        first.append(own_law(result))
    then = f"Until then {use[0].lower()}{use[1:]}" if first else use
    return " ".join([*first, then, "How small an effect these logs would show, `gap power` says."])


def _nearest(answer: Answer) -> list[str]:
    """What an effect gains that uneven noise keeps from being evident."""
    near = nearest(answer)
    if near is None:
        return []
    return [
        f"Nearest to evident: {near.name} gains {nats(near.gain_nats)}; even noise brings up to "
        f"{nats(answer.rounds[0].steady_nats)}, but noise as loud now and then, or as lasting, as "
        f"in these logs up to {nats(near.needed_nats)}."
    ]


def late_words(late: Mapping[str, float]) -> list[str]:
    """What to do about inputs that come too late, by seconds."""
    return [
        f"Doubt what follows: the outputs move {quantity(seconds, 's')} before {name} does, which "
        "drives them. Where the log has two clocks, or stamps or filters it late, bring it forward "
        f"(its shift_s in columns.toml, less by {seconds:.3g}); else the system delays it too much."
        for name, seconds in late.items()
    ]


def members(answer: Answer) -> tuple[str, str]:
    """The member of a class that the correction has, and the next that could take its place."""
    named = {effect.name for effect in answer.effects}
    has = next((name for name in answer.rivals if name in named), answer.rivals[0])
    return has, next((name for name in answer.rivals if name != has), has)


def _open_class(result: Result, planned: "Planned | None") -> str:
    """What to do about a class: what a plan found, and no promise that it does not bear out."""
    called = f"In the commands below that log is called {FURTHER_LOG}."
    if planned is None:
        return (
            "See which input tells them apart, if any; record it, and ask again with that log, "
            f"too. {called}"
        )
    if planned.splits:
        return f"{planned.sentence} Then ask again with that log, too. {called}"
    has, other = members(result)
    return (
        f"{planned.sentence} Until then the correction has `{has}`; the "
        f"command below puts `{other}` in its place."
    )


def _effects(answer: Answer) -> list[str]:
    lines = []
    for effect in answer.effects:
        parts = filter(None, (_sizes(effect), removed_of(answer, effect)))
        lines.append(f"  {effect.name}: {'; '.join(parts)}.")
    return lines


def _sizes(effect: Effect) -> str:
    return ", ".join(_size(*as_read(effect.name, *each)) for each in effect.parameters.items())


def _unsettled(answer: Answer) -> list[str]:
    return [
        f"The fit with {name} was stopped before it came to rest: its size is less sure than its "
        "interval says."
        for name in answer.unsettled
    ]


def _unexplained(answer: Answer) -> list[str]:
    """What still acts: on which rate, how large, how long, and what it follows."""
    lines = []
    for push in answer.unexplained:
        lines.append(
            f"Not explained: on {push.state}, {push.sd:.3g}{behind(push.unit)} (sd) that last "
            f"{push.lasts_s:.2g} s, {whole_percent(push.share)} of the usual rate."
        )
        at = push.against
        if at is not None:
            lines.append(
                f"  It follows {at.coordinate}, which tells {whole_percent(at.share)} of it: "
                f"from {_signed(at.means[0])}{behind(push.unit)} at "
                f"{minus(f'{at.edges[0]:.3g}')}{behind(at.unit)} to "
                f"{_signed(at.means[-1])}{behind(push.unit)} at "
                f"{minus(f'{at.edges[-1]:.3g}')}{behind(at.unit)}."
            )
        lines.append(f"  {_lawful(push)}")
    return lines


def _lawful(push: Leftover) -> str:
    """Whether a push follows a law, and what forecasts would gain by it."""
    law = push.law
    if law is None:
        none = (
            "No law over one coordinate is evident in it"
            if push.against is None
            else "But forecasts bear out no law over one coordinate"
        )
        return f"{none}, nor over one and the direction; a disturbance acts so."
    if law.removes <= 0.0:
        return f"A law over {over(law)} is evident, but forecasts get no better by it."
    removed = Forecast(share=law.removes, low=law.low, high=law.high)
    what = f"A law over {over(law)} is evident, and removes {removed_words(removed)}"
    return f"{what} of the squared forecast error where it was not fitted."


def _size(name: str, size: Size) -> str:
    return f"{spoken(name)} {measured(size.value, size.low, size.high, size.unit)}"


def _signed(value: float) -> str:
    return minus(f"{value:+.3g}")


def _rejected(answer: Answer) -> list[str]:
    """What was evident beside what is named, but is not named itself, and why; what was withdrawn.

    Rivals are named above. A later round may have tried effects beside one that is not named; it
    says nothing of an answer without that one.
    """
    if not answer.rounds:
        return []
    named = {effect.name for effect in answer.effects}
    beside = [searched for searched in answer.rounds if named.issuperset(searched.given)]
    last = (beside or answer.rounds)[-1]
    before = ""
    if last.chosen in named:
        before = f"before `{last.chosen}` was named, and not asked since: "
    judged = {
        effect.name: f"{before}{effect.judged}"
        for effect in last.ranking[:_MOST_RANKED]
        if effect.judged not in ("", ACCEPTED, CHANCE)
    }
    ranked = (effect for searched in answer.rounds for effect in searched.ranking)
    taken_out = {
        e.name: e.judged for e in ranked if e.judged in (UNSEEN_WORSE, OUTDONE, SUPERFLUOUS)
    }
    judged |= taken_out
    mentioned = named | set(answer.rivals)
    return [f"Not named: {name}: {why}." for name, why in judged.items() if name not in mentioned]
