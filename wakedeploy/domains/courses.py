"""Which FlareDW recordings fly the same course, and how courses are shared out among the splits.

In: flights of `quadrotor_files`. Out: a course and a split for each file.

Files are not independent: several fly one plan again with another controller, and their positions
then differ by centimetres. A split by file would test on what was learned from. So files whose
plans agree are one course, and a course is in one split only. Plans that differ by a constant shift
are one course, too: the public files fly one approach below the source and the same 1 m lower, so
that a test on either would repeat the other's way sample by sample. Files without a plan are a
course each, copies of one file the same; their iterations stay together, recorded in one go.

The public folder has three courses below the source, two above it and five that swap places. A
manoeuvre of two is trained and tested, not validated: what is never tested cannot be reported,
while the validation error that ends a training is one number for all manoeuvres.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from wakedeploy.domains.quadrotor_files import Flight

_ROUND = ("train", "test", "validation", "train", "train")
_SAME_M = 1e-3  # by which plans of one course may differ


def courses_of(flights: Sequence[Flight]) -> dict[Path, Path]:
    """The course of each file, named by the first of the files that fly it."""
    first = dict[Path, Flight]()
    for flight in flights:
        first.setdefault(flight.file, flight)
    found = dict[Path, Path]()
    for file, flight in first.items():
        same = (c for c in dict.fromkeys(found.values()) if _again(flight, first[c]))
        found[file] = next(same, file)
    return found


def split_courses(
    flights: Sequence[Flight], courses: Mapping[Path, Path], manoeuvre: Mapping[Path, str]
) -> dict[Path, str]:
    """A split for each course: within each manoeuvre in turn, those with the longest file first.

    Flying a course again makes it no longer. A course belongs to the manoeuvre of its first file.
    """
    files = dict[Path, int]()
    for flight in flights:
        files[flight.file] = files.get(flight.file, 0) + len(flight.label)
    kinds = dict[str, dict[Path, int]]()
    for file, samples in files.items():
        longest = kinds.setdefault(manoeuvre[courses[file]], {})
        longest[courses[file]] = max(samples, longest.get(courses[file], 0))
    return {
        course: _ROUND[place % len(_ROUND)]
        for longest in kinds.values()
        for place, course in enumerate(sorted(longest, key=lambda c: (-longest[c], str(c))))
    }


def _again(first: Flight, other: Flight) -> bool:
    """Whether two files' plans are the same but for a constant shift, as far as the shorter goes.

    Without plans: whether the flights themselves are the same.
    """
    if first.planned_m is None or other.planned_m is None:
        return all(
            np.array_equal(mine, its)
            for mine, its in ((first.source, other.source), (first.sufferer, other.sufferer))
        )
    shorter = min(len(first.planned_m), len(other.planned_m))
    mine, its = (p[:shorter] - p[0] for p in (first.planned_m, other.planned_m))
    return bool((np.abs(mine - its) < _SAME_M).all())
