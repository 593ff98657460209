"""Whether two halves of the logs give the same answer, in words.

In: an answer of a system. Out: sentences for a terminal and a page.
"""

from wakedeploy.gap.search.artefacts import Answer, Half, Size
from wakedeploy.gap.systems.answers.reader_units import as_read
from wakedeploy.gap.wording import halves_said, listed, span, spoken


def repeated_sentences(answer: Answer) -> list[str]:
    """What each half of the logs leads with by itself, and its size; [] where none was asked."""
    again = answer.repeated
    if again is None or len(again.halves) != 2:
        return []
    return [halves_said(again.agree, [_half(half) for half in again.halves], "logs")]


def repeated_answer(answer: Answer) -> str:
    """The same without sizes; "" where no half was asked."""
    again = answer.repeated
    if again is None:
        return ""
    if not again.agree:
        return "The two halves of the logs do not agree: record more."
    if answer.verdict == "class":
        return "Each half of the logs by itself says no more."
    if len(answer.effects) == 1:
        return "Each half of the logs by itself says the same."
    first = answer.effects[0].name
    return f"Each half of the logs by itself says the same of `{first}`, and was asked no further."


def _half(half: Half) -> str:
    """`coulomb-friction@speed_mps (force from 1.1 to 1.3 N)`, and what it cannot be told from."""
    middle = 0.5 * (half.low + half.high)
    size = Size(value=middle, low=half.low, high=half.high, unit=half.unit)
    name, shown = as_read(half.leading, half.parameter, size)
    others = [other for other in half.near if other != half.leading]
    alike = f" or {listed(others, 'or')}" if others else ""
    return f"{half.leading} ({spoken(name)} {span(shown.low, shown.high, shown.unit)}){alike}"
