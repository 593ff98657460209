"""What `name` found, as `show` needs it, in a file beside `name.json`: nothing is searched twice.

In: an answer. Out: `name.npz` with the parameters of its fits and the motions around them.
"""

import io
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from wakedeploy.core.archive import Arrays, read_archive
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import write_bytes_whole
from wakedeploy.core.rig import Rig
from wakedeploy.gap.evidence.fits import NO_SLOPES, Fit, Hypothesis
from wakedeploy.gap.systems.gantry.flight import Flight, FloatArray
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.search.expression_terms import TERMS
from wakedeploy.gap.systems.gantry.search.outcome import Answer

FITS = "name.npz"


@dataclass(frozen=True, eq=False)
class Tried:
    """An effect of the first search, alone; `fitted_gain` [nats] is that where it was fitted."""

    name: str
    fit: Fit
    fitted_gain: float


@dataclass(frozen=True, eq=False)
class Found:
    """`fit` has all that was found, around the motion of `model`; `base` nothing, around its own.

    `fit` has an expression's terms, too. `tried` are sorted by their gain on flights left out, best
    first.
    """

    model: GantryModel
    base_model: GantryModel
    base: Fit
    fit: Fit
    tried: tuple[Tried, ...]

    @classmethod
    def of(cls, answer: Answer) -> "Found":
        """The part of an answer that is kept."""
        ranking = answer.rounds[0].ranking
        tried = tuple(Tried(c.name, c.fit, c.fitted_gain) for c in ranking)
        return cls(answer.model, answer.base_model, answer.base, answer.fit, tried)

    def write(self, folder: Path) -> None:
        """Write `name.npz`."""
        content: dict[str, Any] = {
            "base": self.base.theta,
            "fit": self.fit.theta,
            "effects": np.array(self.fit.hypothesis, dtype=str),
            "tried": np.array([t.name for t in self.tried], dtype=str),
            "fitted_gain": np.array([t.fitted_gain for t in self.tried]),
        }
        content |= {f"tried_{i}": t.fit.theta for i, t in enumerate(self.tried)}
        for i in range(self.model.episodes):
            content[f"motion_{i}"] = self.model.flights[i].nominal
            content[f"base_motion_{i}"] = self.base_model.flights[i].nominal
        packed = io.BytesIO()  # an archive whose disk is full would go on complaining
        np.savez_compressed(packed, **content)
        write_bytes_whole(folder / FITS, packed.getvalue())

    @classmethod
    def read(cls, folder: Path, rig: Rig, flights: Sequence[Flight]) -> "Found":
        """What `name` left in the folder about these flights.

        Raises UnusableInput if the file is missing, damaged or does not belong to `rig`.
        """
        path = folder / FITS
        try:
            return cls._of_file(read_archive(path), rig, flights)
        except (OSError, ValueError, KeyError, UnusableInput) as error:
            raise UnusableInput(
                f"{path}: missing or not readable; run `wakedeploy gap name` again."
            ) from error

    @classmethod
    def _of_file(cls, content: Arrays, rig: Rig, flights: Sequence[Flight]) -> "Found":
        count = range(len(flights))
        base_model = _around(rig, flights, [_numbers(content, f"base_motion_{i}") for i in count])
        model = _around(rig, flights, [_numbers(content, f"motion_{i}") for i in count])
        gains = _numbers(content, "fitted_gain").tolist()
        tried = tuple(
            Tried(name, _fit(base_model, (name,), _numbers(content, f"tried_{i}")), gain)
            for i, (name, gain) in enumerate(zip(_names(content, "tried"), gains, strict=True))
        )
        base = _fit(base_model, (), _numbers(content, "base"))
        fitted = _fit(model, _names(content, "effects"), _numbers(content, "fit"))
        return cls(model, base_model, base, fitted, tried)


def _numbers(content: Arrays, name: str) -> FloatArray:
    """An array of finite numbers, a list at least; ValueError for anything else."""
    values = content[name]
    if values.dtype.kind not in "fiu" or not values.ndim or not np.isfinite(values).all():
        raise ValueError(f"{name} holds something not a number")
    return values.astype(np.float64)


def _names(content: Arrays, name: str) -> tuple[str, ...]:
    """A list of names; ValueError for anything else."""
    values = content[name]
    if values.dtype.kind != "U" or values.ndim != 1:
        raise ValueError(f"{name} is no list of names")
    return tuple(map(str, values))


def _around(rig: Rig, flights: Sequence[Flight], motions: Sequence[FloatArray]) -> GantryModel:
    """The flights around these motions, (2, N) each; ValueError for those of other flights."""
    for flight, motion in zip(flights, motions, strict=True):
        if motion.shape != flight.nominal.shape:
            raise ValueError(f"a motion of {motion.shape} for a flight of {flight.nominal.shape}")
    moved = [replace(f, nominal=motion) for f, motion in zip(flights, motions, strict=True)]
    return GantryModel(rig, moved, TERMS)


def _fit(model: GantryModel, hypothesis: Hypothesis, theta: FloatArray) -> Fit:
    free = model.free(hypothesis)
    if len(free) != len(theta):
        raise ValueError(f"{len(theta)} parameters for {len(free)}")
    # Parameters are what is kept; scores follow from them.
    return Fit(hypothesis, free, tuple(range(model.episodes)), theta, NO_SLOPES, np.zeros(0))
