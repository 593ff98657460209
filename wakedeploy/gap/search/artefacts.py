"""What the steps leave behind, as types: find.json, name.json and domain.json.

In: numbers of a search, or a file. Out: models that a step writes and that the next step, the
report and the terminal read. A missing number (null in JSON) is NaN here. Every file states the
version of its form and the rules by which it was decided.
"""

import math
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import json_of, json_text, text_of, write_text_whole
from wakedeploy.core.validation import first_problem
from wakedeploy.gap.rules import RULES, Rules

VERSION = 4

Verdict = Literal["named", "class", "none", "unknown"]


_LARGEST = 1e60  # a coefficient of the cube of what was measured in the least of units


def _or_nan(value: Any) -> Any:
    unknown = value is None or (isinstance(value, float) and not math.isfinite(value))
    return math.nan if unknown else value


def _within(value: float) -> float:
    if abs(value) > _LARGEST:
        raise ValueError(f"numbers lie within ±{_LARGEST:g}")
    return value


Number = Annotated[float, BeforeValidator(_or_nan), AfterValidator(_within)]


class Part(BaseModel):
    """A part of an artefact; unknown fields are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)


class Artefact(Part):
    """A step's file: the version of its form, the rules, and whose it is.

    `key` is a hash of system and logs; "" where a step is never taken up again.
    """

    version: int = VERSION
    rules: Rules = RULES
    domain: str
    key: str = ""

    def as_json(self) -> dict[str, Any]:
        """As the file has it."""
        return self.model_dump(mode="json", by_alias=True, exclude_none=True)

    def write(self, path: Path) -> None:
        """Write the file, whole or not at all."""
        write_text_whole(path, json_text(self.as_json()))


class Quantity(Part):
    """A value and its unit."""

    value: Number
    unit: str


class Measured(Quantity):
    """A value with its 90 % interval, both in `unit`."""

    low: Number
    high: Number


class Size(Measured):
    """A value with its 90 % interval, both in `unit`.

    Where innovations are not white the interval is wider: `mean_low` to `mean_high` is that of the
    likelihood alone, and `least_squares` is the value with the smallest errors.
    """

    mean_low: Number | None = None
    mean_high: Number | None = None
    least_squares: Number | None = None


Sizes = dict[str, Size]


class Forecast(Part):
    """The share of the squared error of forecasts that goes away, with its 90 % interval."""

    share: Number
    low: Number
    high: Number


class Ranked(Part):
    """An effect in a ranking: its gain [nats] on episodes that it was not fitted to.

    It has to gain `needed_nats`: what chance brings, or less where it gains in block after block.
    `judged` says why it is not named, or "accepted"; it is "" if nobody looked.
    """

    name: str
    gain_nats: Number
    needed_nats: Number
    interval: tuple[Number, Number]
    parameters: Sizes
    note: str = ""
    judged: str = ""
    forecast: Forecast | None = None


class Round(Part):
    """A ranking beside the effects `given`, the gain that chance brings, and what was chosen.

    `steady_nats` is what chance brings without loud moments; steady effects need that much.
    """

    given: list[str]
    threshold_nats: Number
    steady_nats: Number
    ranking: list[Ranked]
    chosen: str | None = None
    rivals: list[str] = Field(default=[], alias="class")
    accepted: Sizes = {}
    sealed_error: list[Number] = []


class Effect(Part):
    """An effect that was named, and what it does on sealed episodes."""

    name: str
    parameters: Sizes
    forecast: Forecast


class Followed(Part):
    """The coordinate that a push follows: its share of the push, and means over ranges."""

    coordinate: str
    unit: str
    share: Number
    edges: list[Number]
    means: list[Number]


class Law(Part):
    """A law over a coordinate, and over the direction of motion where `by_direction`.

    `removes` is the share of forecasts' squared error that it removes, with its 90 % interval.
    """

    coordinate: str
    by_direction: bool
    removes: Number
    low: Number
    high: Number


class Leftover(Part):
    """A push on a state's rate that nothing explains: its sd, and its share of the usual rate.

    `of_parts` is its share of what the rate would be if its inputs did not hold against its states,
    as a servo's command does against its spring. `law` is the most evident function of one
    coordinate that it follows; `matters` says whether the push shows that something unknown is
    missing. `not_offered` are kinds of effect that could act there but that the system's port
    leaves out; without a port (`has_port`) none can.
    """

    state: str
    sd: Number
    unit: str
    lasts_s: Number
    share: Number
    of_parts: Number
    against: Followed | None = None
    law: Law | None = None
    matters: bool
    not_offered: list[str] = []
    has_port: bool = True


class Lead(Part):
    """What one half of the recordings by itself ranks first, and the interval of its size.

    `near` are all that this half cannot tell from the leading one. `gain_nats` is the leading one's
    gain in episodes of the half that it was not fitted to; `parameter` is the one of that size.
    """

    leading: str
    gain_nats: Number
    near: list[str]
    parameter: str
    low: Number
    high: Number
    unit: str


AnyHalf = TypeVar("AnyHalf", bound=Lead)


class Repeated(Part, Generic[AnyHalf]):
    """Both halves; `agree` says whether both give the whole search's answer, at one size."""

    agree: bool
    halves: list[AnyHalf] = []


class Half(Lead):
    """One half of a system's logs; `episodes` are its blocks."""

    episodes: list[str]


class Map(Part):
    """Mean residuals of a channel over ranges of a coordinate; `edges` has one more than `mean`."""

    channel: str
    coordinate: str
    exogenous: bool
    unit: str
    coordinate_unit: str
    edges: list[Number]
    mean: list[Number]
    low: list[Number]
    high: list[Number]
    count: list[Number]
    blocks: list[Number] = []
    p_value: Number
    clarity: Number
    strength: Number
    q_value: Number


class Place(Part):
    """A range where a channel's residuals are off by more than noise, and by how much."""

    channel: str
    coordinate: str
    exogenous: bool
    low: Number
    high: Number
    residual: Number
    unit: str
    coordinate_unit: str
    q_value: Number
    clarity: Number
    words: str


class White(Part):
    """Whether innovations are white: the statistic, its limit, and the autocorrelation at lags."""

    p_value: Number
    statistic: Number
    limit: Number
    passes: bool
    lags: list[int]
    autocorrelation: list[Number]
    by_channel: list[list[Number]] = []
    counts: list[int] = []  # innovations of each channel, where there are several
    samples: int

    @property
    def rows(self) -> list[list[float]]:
        """The autocorrelation of each channel."""
        return self.by_channel or [self.autocorrelation]

    def foretold(self) -> list[float]:
        """The share of each channel's variance that its past foretells, 0 to 1.

        As of a first-order process, whose squared autocorrelations φ² + φ⁴ + … sum to φ²/(1 − φ²);
        less the sum that white noise has.
        """
        counts = self.counts or [self.samples] * len(self.rows)
        by_channel = zip(self.rows, counts, strict=True)
        sums = [sum(r * r for r in row) - len(row) / max(n, 1) for row, n in by_channel]
        return [max(each, 0.0) / (1.0 + max(each, 0.0)) for each in sums]


class WhitePair(Part):
    """How white the innovations are: of the baseline, and with what was found."""

    before: White
    after: White


class Error(Part):
    """A channel's rms error on sealed episodes."""

    before: Number
    after: Number
    unit: str


class Placebo(Part):
    """The best wrong effect in place of what was found; errors by channel, in its unit."""

    name: str
    before: list[Number]
    after: list[Number]
    sealed_gain_nats: Number


class Profile(Part):
    """A channel's mean residual over ranges of a coordinate, before and after."""

    channel: str
    unit: str
    coordinate: str
    coordinate_unit: str
    edges: list[Number]
    before: list[Number]
    after: list[Number]


class Course(Part):
    """A channel along an episode: measured, predicted by the baseline and with what was found."""

    unit: str
    measured: list[Number]
    before: list[Number]
    after: list[Number]


class Trace(Part):
    """One episode, as measured and as predicted."""

    episode: str
    time_s: list[Number]
    channels: dict[str, Course]


class Shown(Part):
    """What the report draws of the sealed episodes."""

    places: list[Profile]
    trace: Trace


class Disagreements(Artefact):
    """find.json: where system and recordings disagree. `theta` is the fit of the system as it is.

    Raises UnusableInput from `read` for a file that no step of this version wrote.
    """

    episodes: list[str]
    sealed: list[str]
    where: list[Place]
    maps: list[Map]
    constants: Sizes
    theta: dict[str, Number] = {}


class Answer(Artefact):
    """name.json: which effects the system lacks.

    Attributes:
        verdict: What was concluded: "named", "class", "unknown" or "none".
        rivals: Effects that cannot be told apart; "class" in the file.
        threshold_nats: What an effect had to gain to be evident.
        effects: Each that was found, with its size, its gain and what it matters.
        parameters: Size, interval and unit of every parameter of what was named.
        constants: The same of the system's constants, as fitted with it.
        stated: These constants as the system states them.
        unknown: Constants of unlimited spread that these logs say nothing of, as they are stated.
        moved: Constants that the fit moved by more than three of their spreads, and by how many.
        late: Inputs that come later than the outputs that they drive, and by how many seconds: two
            clocks, or a delay that the system has too much.
        late_by_a_row: Delays of one sample, of what may have been logged a row too early.
        shifted: By how much inputs act later than their stamps, within half a sample, with what was
            found. A correction has it, and no effect.
        curved: Inputs that act by a curve, where what was named may stand for a lag behind that.
        answered: What inputs do with an effect that was found, as a share of what they do without.
        noise: Sizes of the noise, by what it acts on.
        rounds: What each round of the search ranked.
        unsettled: Fits that did not reach their top.
        unexplained: What acts and follows no effect.
        sealed_gain_nats: What was found gains so much on sealed episodes.
        placebo: What a wrong effect gains there.
        is_outdone: Whether the system's forecasts are no better than the last reading or the mean.
        is_far_ahead: Whether it was asked to predict far ahead: the next reading said too little.
        found_theta: The fit with what was found.
        base_theta: The fit without, from which it was found. It is not always that of find.json:
            effects that are begun anew may show the way to a better one.
        repeated: Whether both `halves` of the logs `agree` about what was found first, each fitted
            by itself. Of each, its `episodes`, what it is `leading` with, what that gains there
            [nats], the interval from `low` to `high` of its size, a `parameter` in its `unit`, and
            all that the half cannot tell from it (`near`). None where nothing was named, and
            where a half has fewer than three blocks.
    """

    verdict: Verdict
    rivals: list[str] = Field(alias="class")
    threshold_nats: Number
    effects: list[Effect]
    parameters: Sizes
    constants: Sizes
    stated: dict[str, Number] = {}  # the constants, as the system states them
    unknown: dict[str, Quantity] = {}
    moved: dict[str, Number] = {}
    late: dict[str, Number] = {}
    late_by_a_row: list[str] = []
    shifted: dict[str, Measured] = {}
    curved: list[str] = []
    answered: dict[str, Number] = {}
    noise: dict[str, Quantity]
    rounds: list[Round]
    unsettled: list[str]
    unexplained: list[Leftover] = []
    sealed_gain_nats: Number
    placebo: Placebo | None = None
    is_outdone: bool = False
    is_far_ahead: bool = False
    found_theta: dict[str, Number] = {}
    base_theta: dict[str, Number] = {}
    repeated: Repeated[Half] | None = None

    @property
    def shifted_together(self) -> list[tuple[list[str], Measured]]:
        """The inputs that are `shifted`, those that are so alike as one."""
        together: list[tuple[list[str], Measured]] = []
        for name, by in self.shifted.items():
            names = next((names for names, other in together if other == by), None)
            if names is None:
                together.append(([name], by))
            else:
                names.append(name)
        return together


class BeforeAfter(Artefact):
    """The gap on sealed episodes before and after, as domain.json has it beside the answer."""

    gap: dict[str, Error]
    removed: Forecast
    white: WhitePair
    shown: Shown
    forecast_s: Number | None = None


class StepResponse(Part):
    """Single steps of a motor: how many, and the median time constant [s]."""

    steps: int
    median_s: Number


class SingleSteps(Part):
    """An exponential fitted to each step alone, with its time constant [s] by name."""

    up: StepResponse
    down: StepResponse
    tau_s: dict[str, Number]


class DelayProfile(Part):
    """The largest log likelihood [nats below the best] at each transport delay [s]."""

    delay_s: list[Number]
    nats: list[Number]


class PhaseDelay(Part):
    """The delay [s] over the frequency [Hz], from the cross-spectrum."""

    frequency_hz: list[Number]
    delay_s: list[Number]


class Turning(Part):
    """Logged less derived acceleration against that of turning axes, z axis; rms in m/s²."""

    slope: Number
    correlation: Number
    rms_mps2: Number
    rms_left_mps2: Number
    p_value: Number


class Spread(Part):
    """Mean, rms and largest size of each axis [N]."""

    mean: list[Number]
    rms: list[Number]
    largest: list[Number]


class Stated(Part):
    """Largest difference [N] of a published label from ours, inside flights and near their cuts."""

    inside: Number
    near_cuts: Number


class LabelAudit(Part):
    """What is wrong with the force label of a group of flights, rms of the z axis in newtons."""

    flights: int
    seconds: Number
    outside_thrust_fit_share: Number
    constant_n: Number
    acceleration_less_derivative: Turning
    source_acceleration_less_derivative: Turning
    angular_acceleration_correlation: list[Number]
    label_rms_n: Number
    corrected_rms_n: Number
    stated_label: Stated | None = None
    far_seconds: Number
    far_label_n: Spread | None = None
    far_corrected_n: Spread | None = None


class Result(Disagreements, Answer, BeforeAfter):
    """domain.json: all steps together, and what one domain alone adds.

    `label` is an audit of published forces by group of flights, `far` the same steps where no wake
    is, `hidden` what a simulation had been given.
    """

    single_steps: SingleSteps | None = None
    delay_profile: DelayProfile | None = None
    phase_delay: PhaseDelay | None = None
    label: dict[str, LabelAudit] = {}
    far: "Result | None" = None
    hidden: dict[str, Number] = {}


Kind = TypeVar("Kind", bound=Artefact)


def joined(found: Disagreements, answer: Answer, shown: BeforeAfter) -> Result:
    """The three steps as one."""
    parts = {name: value for step in (found, answer, shown) for name, value in step}
    return Result(**parts)


def read(path: Path, kind: type[Kind], key: str) -> Kind | None:
    """What a step has left; None for no file, and for one of another system or other logs.

    Raises UnusableInput where it cannot be read, or no step of this version wrote it.
    """
    if not path.exists():
        return None
    try:
        content = json_of(text_of(path))
    except (OSError, ValueError) as error:
        raise UnusableInput(f"{path} cannot be read; delete it to run the step anew.") from error
    if not isinstance(content, dict) or content.get("key") != key:
        return None
    return stated(path, content, kind, "delete it to run the step anew")


def read_result(path: Path) -> Result:
    """What all steps have left; UnusableInput where it cannot be read, or is of another form."""
    again = "run `wakedeploy gap close` again"
    return stated(path, object_of(path, again), Result, again)


def object_of(path: Path, otherwise: str) -> dict[str, Any]:
    """A file's JSON object; UnusableInput, with what to do `otherwise`, for none."""
    try:
        content = json_of(text_of(path))
    except (OSError, ValueError) as error:
        raise UnusableInput(f"{path} cannot be read; {otherwise}.") from error
    if not isinstance(content, dict):
        raise UnusableInput(f"{path} holds no JSON object; {otherwise}.")
    return content


Form = TypeVar("Form", bound=Part)


def stated(path: Path, content: dict[str, Any], kind: type[Form], otherwise: str) -> Form:
    """What a file says, as a type; UnusableInput, with what to do `otherwise`, for another form."""
    if content.get("version") != VERSION:
        raise UnusableInput(
            f"{path}: version {content.get('version', 'not stated')}; this program reads {VERSION};"
            f" {otherwise}."
        )
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        raise UnusableInput(f"{path}: {first_problem(error)}; {otherwise}.") from error
