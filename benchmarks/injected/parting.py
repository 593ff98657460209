"""Many faults of one flight: what comes before them is flown once, and then the process parts.

Each fault goes on in a copy of the process, made by a fork in the middle of the flight.
"""

import os
import pickle
import traceback
from collections.abc import Sequence
from dataclasses import replace
from typing import NoReturn

from benchmarks.injected.fault import Scene
from benchmarks.injected.flight import Case, Flown, break_it, flown, scene_of


class Parted(BaseException):
    """All copies have flown; the original flies no further."""


def fly_all(cases: Sequence[Case]) -> list[Flown]:
    """Fly cases that differ in their fault alone, and in nothing that their rig files say."""
    scene = scene_of(cases[0])
    parting = _Parting(scene, cases)
    scene.later(0.0, parting.part)
    try:
        result = flown(scene, cases[0])
    except Parted:
        pass
    except BaseException:
        if parting.own_case is not None:
            traceback.print_exc()
            os._exit(1)
        raise
    else:
        if parting.own_case is not None:
            parting.tell(result)
    if len(parting.results) < len(cases):
        raise RuntimeError(f"{cases[len(parting.results)]}: was not flown to its end.")
    return parting.results


class _Parting:
    """What the original has been told; in a copy, its own case and the way to tell."""

    def __init__(self, scene: Scene, cases: Sequence[Case]) -> None:
        self._scene, self._cases = scene, cases
        self.results: list[Flown] = []
        self.own_case: Case | None = None
        self._pipe = -1

    def part(self) -> None:
        """In the original: let each copy fly, then stop. In a copy: let its fault begin."""
        for case in self._cases:
            reading, self._pipe = os.pipe()
            child = os.fork()
            if child == 0:
                self.own_case = case
                break_it(self._scene, case.fault)
                return
            os.close(self._pipe)
            with os.fdopen(reading, "rb") as pipe:
                data = pipe.read()
            os.waitpid(child, 0)
            if not data:
                break
            self.results.append(pickle.loads(data))
        self._scene.world.on_step = lambda t_s: None
        raise Parted

    def tell(self, result: Flown) -> NoReturn:
        """Give the original this copy's result, and end the copy."""
        assert self.own_case is not None
        with os.fdopen(self._pipe, "wb") as pipe:
            pickle.dump(replace(result, case=self.own_case), pipe)
        os._exit(0)
