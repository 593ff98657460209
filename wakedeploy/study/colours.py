"""How the eight architectures look in every study's figures: a colour and a marker each.

Black, green and dotted lines are kept for limits: what flies or predicts without having learned.
"""

import itertools
from collections.abc import Sequence

from wakedeploy.core import figures

_LOOKS = {
    "agile-mlp": (figures.LIMIT, "s"),
    "history-mlp": ("#E69F00", "o"),
    "delay-embedding": ("#56B4E9", "^"),
    "gru": ("#D55E00", "D"),
    "tcn": ("#0072B2", "v"),
    "mamba": ("#CC79A7", "P"),
    "esn": ("#8C564B", "X"),
    "cross-attention": ("#6A3D9A", "p"),
}
_COLOURS, _MARKERS = ("#B8A900", "#17BECF", "#F781BF"), "<>hd8*"  # for a ninth model and more


def looks(names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """The colour and the marker of each, the same in all studies; of others, by their order."""
    others = itertools.cycle((colour, mark) for mark in _MARKERS for colour in _COLOURS)
    return {name: _LOOKS.get(name) or next(others) for name in names}
