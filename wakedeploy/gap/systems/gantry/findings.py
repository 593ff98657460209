"""What the gantry's artefacts say of effects and of errors: the parts that several of them share.

In: numbers of a search. Out: models; a missing number is NaN.
"""

import math
from typing import Any, Literal

from pydantic import Field

from wakedeploy.core.rig import EffectParameter
from wakedeploy.gap.search.artefacts import (
    Error,
    Forecast,
    Lead,
    Measured,
    Number,
    Part,
    Repeated,
)

_NAN = math.nan


Verdict = Literal["named", "class", "none", "unknown", "inconclusive"]


class Size(Measured):
    """A parameter's value and interval.

    `at_bound`: it is at an end of the library's range. `holds_neutral`: its interval holds the
    value that changes nothing.
    """

    at_bound: bool = False
    holds_neutral: bool = False


Sizes = dict[str, Size]


class Tracking(Part):
    """The height error [m] of a controller that does not know of a force, with 90 % interval."""

    value: Number = _NAN
    low: Number = _NAN
    high: Number = _NAN


class Worth(Part):
    """What an effect is worth on flights that it was not fitted to.

    `removed` is by horizon; `placebo_removed` and `placebo_gain_nats` are a wrong effect's, if
    there is one.
    """

    matters: bool
    confirmed: bool = True
    removed: dict[str, Forecast] = {}
    sealed_gain_nats: Number = _NAN
    force_n: Number = _NAN
    tracking_m: Tracking = Tracking()
    placebo_removed: dict[str, Number] | None = None
    placebo_gain_nats: Number = _NAN


class WithParameters(Part):
    """Something with sizes that a rig file may state."""

    parameters: Sizes = {}

    def entries(self) -> dict[str, EffectParameter]:
        """The parameters as a rig file states them; ValidationError for impossible sizes."""
        kept = set(EffectParameter.model_fields)
        plain = {name: size.model_dump(include=kept) for name, size in self.parameters.items()}
        return {name: EffectParameter(**_known(size)) for name, size in plain.items()}


def _known(size: dict[str, Any]) -> dict[str, Any]:
    """None in place of missing numbers."""
    return {k: None if isinstance(v, float) and math.isnan(v) else v for k, v in size.items()}


class Sized(WithParameters):
    """An effect with its parameters."""

    name: str


class Effect(Sized):
    """An effect of an answer: how sure its name is, and its gain [nats] on flights left out."""

    confidence: Number = _NAN
    gain_nats: Number = _NAN
    worth: Worth | None = None

    @property
    def matters(self) -> bool:
        """Whether it was found to matter; an effect that no flight has judged is taken to."""
        return self.worth is None or self.worth.matters


class Ranked(Sized):
    """An effect in a ranking, with the 90 % interval of its gain.

    `needed_nats` is what it has to gain, if that is not the round's threshold.
    """

    gain_nats: Number
    interval: tuple[Number, Number]
    confidence: Number = _NAN
    needed_nats: Number = _NAN


class Round(Part):
    """A ranking on top of the effects `given`; `found` is the effect taken, "" for none.

    `near_nats` is how near the best a rival is. `threshold_nats` is what chance alone gains, if
    that is simulated.
    """

    given: list[str]
    found: str = ""
    near_nats: Number = _NAN
    threshold_nats: Number = _NAN
    ranking: list[Ranked]


class Confusion(Part):
    """What the best version of the column's effect loses if the row's is the truth [nats]."""

    names: list[str] = []
    loss_nats: list[list[Number]] = []


class Detectable(Part):
    """The smallest size that would have been found; NaN if none, or if it is not `known`."""

    parameter: str
    size: Number
    unit: str
    known: bool = True


class Expression(WithParameters):
    """A force without a name: an expression, what it depends on, what it gains.

    `force_n` is a rest's size along the flights; `worth` is what sealed flights say of it.
    """

    text: str = ""
    expression: str = ""
    coordinates: list[str] = []
    gain_nats: Number = _NAN
    terms: list[str] = []
    force_n: Number = _NAN
    worth: Worth | None = None


class Leading(Part):
    """The effects that few flights favour most, and what comes after them.

    `clear` says that they gain more than noise and calibration alone.
    """

    clear: bool
    names: list[str]
    others: list[str] = []
    gain_nats: Number
    next: str | None = None
    next_nats: Number = _NAN
    threshold_nats: Number = _NAN


class Bent(Part):
    """A calibrated constant that the flights want `away_sd` spreads from the rig's value."""

    name: str
    stated: Number
    spread: Number
    fitted: Number
    away_sd: Number


class Half(Lead):
    """One half of the flights by itself."""

    flights: list[str]


class Answer(Part):
    """What is missing, as name.json and result.json say it.

    `rivals` cannot be told apart, nor can those of each of `more_classes`; `others` are nearly as
    near. `beside` explains a part of what is unknown, `rest` is left beyond what was found, `small`
    is there and does not matter, and sealed flights do not bear out `withdrawn`. `explainable` is
    what any explanation could remove if none was found.
    """

    verdict: Verdict | None = None
    effects: list[Effect] = []
    rivals: list[str] = Field(default=[], alias="class")
    more_classes: list[list[str]] = []
    others: list[str] = []
    leading: Leading | None = None
    detectable: dict[str, Detectable] = {}
    unknown: Expression | None = None
    rest: Expression | None = None
    beside: list[Sized] = []
    closest: str = ""
    form_exact: bool = True
    unsettled: list[str] = []
    calibration: list[Bent] = []
    withdrawn: list[Effect] = []
    small: Expression | None = None
    worth: Worth | None = None
    explainable: Forecast | None = None
    repeated: Repeated[Half] | None = None

    @property
    def claims(self) -> bool:
        """Whether the verdict says that something is missing."""
        return self.verdict in ("named", "class", "unknown")

    @property
    def to_add(self) -> list[Effect]:
        """The named effects that a rig file gets without being asked: those that matter."""
        return [effect for effect in self.effects if effect.matters]


class Gap(Error):
    """A channel's error before and after, rms, with 90 % intervals, and what noise alone gives.

    `closed` is (before² − after²) / (before² − floor²); NaN where noise errs nearly as much.
    """

    noise_floor: Number = _NAN
    before_interval: tuple[Number, Number] = (_NAN, _NAN)
    after_interval: tuple[Number, Number] = (_NAN, _NAN)
    closed: Number = _NAN


class Placebo(Part):
    """The best wrong effect in place of what was found; `helps` says that it gains clearly."""

    name: str
    before: Number
    after: Number
    after_interval: tuple[Number, Number] = (_NAN, _NAN)
    unit: str
    gain_nats: Number = _NAN
    found_gain_nats: Number = _NAN
    helps: bool


Interval = tuple[Number, Number] | None


class Scores(Part):
    """Errors of two predictors in `unit`, with 90 % intervals over flights; None for one flight."""

    old_rmse: Number
    old_rmse_interval: Interval = None
    new_rmse: Number
    new_rmse_interval: Interval = None
    ratio: Number = _NAN
    ratio_interval: Interval = None
    flights: int = 0


class Retraining(Scores):
    """Predictors trained on the old and on the corrected simulation, scored on measured flights.

    `by_old_label` are the same errors on the force as the old rig measures it; `label_sd` is the
    measured force's own error, `measured_rms` its size.
    """

    unit: str = "N"
    by_old_label: Scores | None = None
    scored_on: list[str] = []
    label_sd: Number = _NAN
    measured_rms: Number = _NAN
    arch: str = ""
    minutes: Number = _NAN
    lead_s: dict[str, Number] = {}
    packages: dict[str, str] = {}


class Judged(Part):
    """What flights that nothing was fitted to say, as in show.json and result.json.

    `as_if` are effects with which the error after is shown although no rig file got them;
    `hidden_by` are constants that are bent without what was found but not with it.
    """

    in_sample: bool = False
    cross_validated: bool = False
    gap: dict[str, Gap] = {}
    placebo: Placebo | None = None
    as_if: list[str] = []
    hidden_by: list[Bent] = []
    log_density_gain_nats: Number = _NAN


class Splitting(Part):
    """What would split a class: the manoeuvre, or the sensors that the library knows.

    `manoeuvre` is None if none was looked for, or if none of the menu (`is_searched`) splits it;
    `seconds` is how long all its flights take.
    """

    sentence: str
    manoeuvre: str | None = None
    flights: int | None = None
    seconds: Number = _NAN
    split_by: dict[str, str] = {}
    is_searched: bool = False


class Advice(Part):
    """What to do next: a reason, and the commands in their order."""

    why: str
    commands: list[str] = []

    @property
    def text(self) -> str:
        """What a terminal shows: `Next: …`, then a command per line."""
        return "\n".join([f"Next: {self.why}:", *(f"  {command}" for command in self.commands)])


class Told(Answer, Judged):
    """The answer and how it was judged, with what stands beside them in result.json.

    `members` are the sizes of each effect of a class, or of those that lead; `flights` includes the
    sealed ones.
    """

    members: list[Effect] = []
    plan: Splitting | None = None
    flights: int = 0
    next: Advice | None = None
