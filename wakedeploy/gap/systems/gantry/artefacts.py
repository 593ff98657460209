"""What the gantry's steps leave behind, as types: find, name, add, show, result and plan.

In: numbers of a search, or a file. Out: models that a step writes and that the next step, the
report and users read. A missing number (null in JSON) is NaN here. Every file states the version of
its form and the rules by which it was decided.
"""

import math
from pathlib import Path
from typing import Any

from pydantic import Field

from wakedeploy.core.files import finite
from wakedeploy.core.rig import Effect as RigEffect
from wakedeploy.gap.search.artefacts import (
    VERSION,
    Map,
    Number,
    Part,
    Place,
    Quantity,
    White,
    WhitePair,
)
from wakedeploy.gap.search.artefacts import Profile as PlainProfile
from wakedeploy.gap.systems.gantry.findings import (
    Answer,
    Confusion,
    Judged,
    Ranked,
    Retraining,
    Round,
    Sized,
    Splitting,
    Told,
)
from wakedeploy.gap.systems.gantry.rules import RULES, GantryRules

_NAN = math.nan


class Artefact(Part):
    """A file of a step: the version of its form, and the rules."""

    version: int = VERSION
    rules: GantryRules = RULES

    def as_json(self) -> dict[str, Any]:
        """The file's content; an unknown number is null."""
        content: dict[str, Any] = finite(self.model_dump(mode="json", by_alias=True))
        return content


class Log(Part):
    """A recording: airborne seconds, range samples, what had to be assumed of it.

    `seed` is that of a simulated flight.
    """

    path: str
    sha256: str
    seconds: Number = _NAN
    samples: int = 0
    notes: list[str] = []
    seed: int | None = None
    simulated: bool = False


class Unflown(Part):
    """A log that is left out, as it holds no flight or too short a one, and why.

    `seed` is that of a simulated flight.
    """

    path: str
    why: str
    seed: int | None = None

    @property
    def sentence(self) -> str:
        """For a person."""
        return f"Left out: {Path(self.path).name}, {self.why}."


class Split(Part):
    """Names of the flights that were fitted, and of those kept apart."""

    fit: list[str] = []
    sealed: list[str] = []


class Spectrum(Part):
    """Power density of innovations, 1 for white noise, and the bounds of 95 % of its bands."""

    frequency_hz: list[Number]
    density: list[Number]
    low: Number
    high: Number


class Replay(Part):
    """Error of an open-loop replay after a horizon, and what the model expects of itself."""

    horizon_s: Number
    rmse_m: Number
    expected_m: Number


class Find(Artefact):
    """find.json: where the rig file and its flights disagree.

    `noise_floor` is what noise alone puts into a bin of a channel's maps; `least_residual` is the
    size from which a place of the channel counts.
    """

    rig: str | None = None
    rig_sha256: str = ""
    logs: list[Log] = []
    unflown: list[Unflown] = []
    split: Split = Split()
    white: White | None = None
    places: list[Place] = []
    maps: list[Map] = []
    spectrum: Spectrum | None = None
    replay: list[Replay] = []
    noise_floor: dict[str, Quantity] = {}
    least_residual: dict[str, Quantity] = {}
    sentence: str = ""

    @property
    def next_seed(self) -> int:
        """A seed that no simulated flight had, and no start that failed."""
        seeds = [log.seed for log in self.logs] + [log.seed for log in self.unflown]
        return max((seed for seed in seeds if seed is not None), default=0) + 1


class Name(Artefact, Answer):
    """name.json: which effect explains it.

    `together` are the sizes of all that was found, fitted as one. `threshold_of_s` is the time of
    flight that thresholds were simulated for; `seconds` is how long the search took.
    """

    untried: list[str] = []
    split_by: str = ""
    rounds: list[Round] = []
    confusion: Confusion = Confusion()
    together: list[Sized] = []
    white: White | None = None
    fitted_flights: int = 0
    threshold_of_s: Number = _NAN
    noise: dict[str, Quantity] = {}
    seconds: Number = _NAN

    @property
    def ranked(self) -> dict[str, Ranked]:
        """Every effect that was ranked, as in its last round."""
        return {entry.name: entry for searched in self.rounds for entry in searched.ranking}


class Add(Artefact):
    """add.json: what the new rig file has beside the old one."""

    rig: str
    old_sha256: str
    new_sha256: str
    effects: list[RigEffect]


class Profile(PlainProfile):
    """A channel's mean residual per bin, before and after, and the reach of 90 % intervals."""

    before_reach: list[Number] = []
    after_reach: list[Number] = []


class SpectrumPair(Part):
    """The spectra with the rig file as it is, and with what was found."""

    before: Spectrum
    after: Spectrum


class Traces(Part):
    """Forecasts 0.25 s ahead along part of one flight, before and after."""

    t_s: list[Number]
    measured_m: list[Number]
    before_m: list[Number]
    after_m: list[Number]


class Show(Artefact, Judged):
    """show.json: the gap before and after; `sealed` is empty if the flights shown were fitted."""

    shown_on: list[str] = []
    sealed: list[str] = []
    places: list[Profile] = []
    white: WhitePair | None = None
    spectrum: SpectrumPair | None = None
    traces: Traces | None = None
    retrain: Retraining | None = None


class Option(Part):
    """A manoeuvre, what each rival loses in one flight, and how many flights split every pair."""

    manoeuvre: str
    description: str
    seconds: Number
    loss_nats: list[list[Number]]
    worst_nats: Number
    flights: int | None = None


class Plan(Artefact, Splitting):
    """plan.json: every manoeuvre of the menu, judged for the class `rivals`."""

    rivals: list[str] = Field(alias="class")
    margin_nats: Number = _NAN
    options: list[Option] = []


class Result(Artefact, Told):
    """result.json: all steps together, headed by a sentence; `where` is that of find.json."""

    where: list[Place] = []
    headline: str = ""
    unflown: list[Unflown] = []


class Summary(Told):
    """All that the account of a folder looks at, whichever step wrote it.

    `white` is of what was found, `white_before` of the rig file as it is; `places` are None where
    nobody has looked.
    """

    places: list[Place] | None = None
    logs: list[Log] = []
    unflown: list[Unflown] = []
    split: Split = Split()
    split_by: str = ""
    white: White | None = None
    white_before: White | None = None
    threshold_of_s: Number = _NAN
    sealed: list[str] = []
    retrain: Retraining | None = None
