"""What a fault is, and what it may touch when it begins."""

import contextlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.injected.world import FaultyForecast, FaultyGantry, Rows
from runtime.loop.loop import Loop
from wakedeploy.core.rig import Rig


@dataclass
class Scene:
    """A flight in which a fault begins: the world, the loop, and where predictions and rows pass.

    `forecast` is None where PID flies alone; `patches` are undone when the fault ends.
    """

    world: FaultyGantry
    loop: Loop
    forecast: FaultyForecast | None
    rows: Rows
    rig: Rig
    rng: np.random.Generator
    seed: int
    begins_s: float
    height_m: float = 0.0  # where the sufferer was when the fault began
    to_come: list[tuple[float, Callable[[], None]]] = field(default_factory=list)
    patches: contextlib.ExitStack = field(default_factory=contextlib.ExitStack)

    @property
    def predictor(self) -> FaultyForecast:
        """The predictor of a fault that needs one."""
        assert self.forecast is not None
        return self.forecast

    def later(self, seconds: float, act: Callable[[], None]) -> None:
        """Do something so long after the fault began."""
        self.to_come.append((self.begins_s + seconds, act))
        self.to_come.sort(key=lambda event: event[0])

    def let_happen(self, t_s: float) -> None:
        """Do what is to be done by now."""
        while self.to_come and self.to_come[0][0] <= t_s:
            self.to_come.pop(0)[1]()

    def restore(self) -> None:
        """End the fault."""
        self.patches.close()
        self.world.restore()
        if self.forecast is not None:
            self.forecast.restore()


@dataclass(frozen=True)
class Fault:
    """One way to break: `begin` is called once, when it breaks; after `lasts_s` it is over.

    `obeys`: the motors still do what the loop commands. `survivable`: some command could land the
    sufferer softly. `rig`: what the rig file says more than the default one.
    """

    name: str
    sentence: str
    group: str
    begin: Callable[[Scene], None]
    lasts_s: float = math.inf
    obeys: bool = True
    survivable: bool = True
    needs_predictor: bool = False
    rig: Mapping[str, Any] = field(default_factory=dict)

    def for_a_time(self, seconds: float) -> "Fault":
        """The same, over after so long."""
        name, sentence = f"{self.name}, {seconds:g} s", f"{self.sentence} For {seconds:g} s."
        return replace(self, name=name, sentence=sentence, lasts_s=seconds)


def nothing(scene: Scene) -> None:
    """No fault."""


NONE = Fault("none", "Nothing breaks.", "none", nothing)
