"""The constants as they were fitted beside what was found, and those that moved too far.

In: an answer. Out: sentences and rows.
"""

from wakedeploy.gap.rules import RULES
from wakedeploy.gap.search.artefacts import Answer, Size
from wakedeploy.gap.systems.kinds.library import kinds_of
from wakedeploy.gap.wording import listed, measured, minus, scale_of

_MOST_TOLD = 12
_UNKNOWN = "not known from these logs"
_NEXT_TO_NOTHING = 0.01  # of its stated value: a constant that keeps its sign stops before 0


def moved_words(answer: Answer) -> list[str]:
    """What to doubt where a constant left its spread, and what it may stand for."""
    if not answer.moved:
        return []
    each = [
        f"{name}{_way(answer, name)} by {abs(spreads):.0f}"
        for name, spreads in answer.moved.items()
    ]
    gains = [f"`{name}`" for name in _unnamed_gains(answer)]
    instead = "Or it stands for an effect that was ranked and not named:"
    or_a_gain = f" {instead} {listed(gains, 'or')}." if gains else ""
    return [
        f"Doubt what follows: to fit, the search moved {listed(each)} of the spreads that the "
        f"system states. A unit may be wrong, there or of a column, or there is a load that the "
        f"system does not have.{or_a_gain}"
    ]


def constant_rows(answer: Answer) -> list[tuple[str, str, str]]:
    """Name, stated value, fitted value with its interval, of each constant that was fitted.

    Those that the logs say nothing of come last.
    """
    return [
        *(
            (
                name,
                _plainly(answer.stated[name], [answer.stated[name]], size.unit),
                measured(size.value, size.low, size.high, size.unit),
            )
            for name, size in answer.constants.items()
        ),
        *(
            (name, _plainly(each.value, [each.value], each.unit), _UNKNOWN)
            for name, each in answer.unknown.items()
        ),
    ]


def constant_words(answer: Answer) -> list[str]:
    """The constants in lines; of many the first, those that moved before the others.

    If nothing was named, only those that the logs want other than as stated. Those that they say
    nothing of are said in any case: nobody else knows them.
    """
    return [*_fitted_words(answer), *_unknown_words(answer)]


def _unknown_words(answer: Answer) -> list[str]:
    return (
        [
            f"Constants that are {_UNKNOWN}, as no output shows them, and stay as stated: "
            f"{listed([*answer.unknown])}."
        ]
        if answer.unknown
        else []
    )


def _fitted_words(answer: Answer) -> list[str]:
    rows = [row for row in constant_rows(answer) if row[0] in answer.constants]
    rows = sorted(rows, key=lambda row: row[0] not in answer.moved)
    is_quiet = answer.verdict == "none" and not answer.moved
    if is_quiet:
        otherwise = told_otherwise(answer)
        rows = [row for row in rows if row[0] in otherwise]
    if not rows:
        return []
    lines = [
        f"  {name}: stated {known}, fitted {fitted}{_stopped(answer, name)}"
        for name, known, fitted in rows
    ]
    lines = lines[:_MOST_TOLD]
    more = len(rows) - len(lines)
    rest = [f"  and {more} more, in the report"] if more else []
    beside = " beside it" if answer.effects else ""
    if is_quiet:
        beside = ", where the logs know them better than is stated"
    return [f"Constants, as fitted{beside}:", *lines, *rest]


def _stopped(answer: Answer, name: str) -> str:
    """That a constant ended at its bound; near 0 its sign may be wrong. "" for all others."""
    size = answer.constants[name]
    if size.value not in (size.low, size.high) or size.low == size.high:
        return ""
    near_0 = abs(size.value) < _NEXT_TO_NOTHING * abs(answer.stated[name])
    return f", as far{' towards 0' if near_0 else ''} as it may go"


def told_otherwise(answer: Answer) -> list[str]:
    """Constants whose stated value is far outside the interval that the logs give, and no trifle.

    That is no contradiction: a wide spread says that nobody knows them well. One that ended at its
    bound is left out: the logs pull it farther than it may go, which no value explains.
    """
    return [
        n
        for n, size in answer.constants.items()
        if _is_otherwise(answer.stated[n], size) and not _stopped(answer, n)
    ]


def _is_otherwise(stated: float, size: Size) -> bool:
    """Whether it is twice as far as the end of the interval to its side; a bound cuts the other."""
    away = abs(stated - size.value)
    end = size.low if stated < size.value else size.high
    least = RULES.constant_trifle * max(abs(stated), abs(size.value))
    return away > max(RULES.constant_ends * abs(end - size.value), least)


def _way(answer: Answer, name: str) -> str:
    """` (from 0.325 m to 0.302 m)`."""
    size, stated = answer.constants[name], answer.stated[name]
    begin, end = (
        _plainly(value, [size.value, stated], size.unit) for value in (stated, size.value)
    )
    return f" (from {begin} to {end})"


def _plainly(value: float, beside: list[float], unit: str) -> str:
    """A number as a person writes one, in the unit that fits those beside it."""
    factor, shown = scale_of(beside, unit)
    return f"{minus(f'{factor * value:.4g}')} {shown}".rstrip()


def _unnamed_gains(answer: Answer) -> list[str]:
    """Gains, for which a constant may stand, that the last round ranked; the clearest first."""
    named = {effect.name for effect in answer.effects}
    last = answer.rounds[-1].ranking if answer.rounds else []
    clear = [each for each in last if each.gain_nats > RULES.hides_nats and each.name not in named]
    return [each.name for each in clear if any(k.is_gain for k in kinds_of(each.name))]
