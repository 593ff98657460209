"""Single numbers far from all others of a column, as a glitch of a bus leaves them."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wakedeploy.core.episodes import EpisodeSet

_FAR = 5.0  # times the range of all others
_APART = 3  # numbers from one spike to the next: nearer ones may be one event
_ENOUGH, _FEW = 50, 0.005  # numbers that tell a spike, and the share of them that may be such


def spikes_in(values: NDArray[np.floating[Any]]) -> NDArray[np.intp]:
    """Where in (n,) the numbers are that lie further off the middle than all others, by far.

    Far is several times the range of those others, which do differ. Nowhere in most columns, and
    where there are too many to be single ones, or several in a row: a pulse, or a step at the end.
    """
    there = np.flatnonzero(np.isfinite(values))
    if len(there) < _ENOUGH:
        return there[:0]
    numbers = values[there].astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):  # what is absurdly large is refused later
        off = np.abs(numbers - np.median(numbers))
        from_middle = np.argsort(off, kind="stable")
        ordered, off = numbers[from_middle], off[from_middle]
        spans = np.maximum.accumulate(ordered)[:-1] - np.minimum.accumulate(ordered)[:-1]
        is_far = (np.diff(off) > _FAR * spans) & (spans > 0.0)
    is_far[: -max(1, int(_FEW * len(there)))] = False
    first = int(np.argmax(is_far)) + 1 if is_far.any() else len(there)
    places = np.sort(from_middle[first:])
    in_a_row = np.any(np.diff(places) < _APART)
    return there[:0] if in_a_row else there[places]


def on_spikes(data: EpisodeSet) -> Iterator[str]:
    """A sentence for each channel of a set in which a number lies far from all others."""
    for kind, channels in (("observation", data.observation), ("force", data.force)):
        for k, channel in enumerate(channels):
            columns = [np.asarray(e.arrays[kind][:, k]) for e in data.episodes]
            values = np.concatenate(columns)
            spikes = spikes_in(values)
            if not len(spikes):
                continue
            others = np.delete(values, spikes)
            ends = np.cumsum([len(column) for column in columns])
            which = int(np.searchsorted(ends, spikes[0], side="right"))
            at = int(spikes[0] - ends[which] + len(columns[which]))
            yield (
                f"{channel.name} is {values[spikes[0]]:.4g} {channel.unit} at sample {at} of"
                f" episode {data.episodes[which].name}, and {others.min():.4g} to"
                f" {others.max():.4g} elsewhere: a training follows it, and so does an error. If it"
                " is no measurement, mend the recording or end the episode before it."
            )
