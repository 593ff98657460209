"""How the architectures look in every study's figures: a colour and a marker each.

Black, green and dotted lines are kept for limits: what flies or predicts without having learned.
"""

import itertools
from collections.abc import Sequence

_COLOURS, _MARKERS = ("#B8A900", "#17BECF", "#F781BF"), "<>hd8*"  # for whoever states none


def looks(names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """The colour and the marker of each, the same in all studies; of others, by their order."""
    others = itertools.cycle((colour, mark) for mark in _MARKERS for colour in _COLOURS)
    return {name: _stated(name) or next(others) for name in names}


def _stated(name: str) -> tuple[str, str] | None:
    """What an architecture's own file says of how it is drawn; None where it says nothing."""
    from trainers.build import ARCHITECTURES

    known = ARCHITECTURES.get(name)
    return (known.colour, known.marker) if known and known.colour and known.marker else None
