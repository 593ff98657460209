"""The benchmark's lines, read and checked: what a table or a later run goes by is sound.

In: a folder with `cases.jsonl`. Out: one mapping for each case that is finished.
"""

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.files import read_json_lines
from wakedeploy.core.validation import first_problem

LINES = "cases.jsonl"

_LARGEST = 1e15
Number = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST)]
Known = Number | None
Positive = Annotated[float, Field(gt=0, le=_LARGEST)]


class _Part(BaseModel):
    """It may say more than what is asked for."""

    model_config = ConfigDict(strict=True, extra="allow")


class _Held(_Part):
    effect: str
    held: bool


class _Belief(_Part):
    confidence: Annotated[float, Field(ge=0, le=1)]
    hidden: bool


class _Error(_Part):
    rmse: Known
    low: Known
    high: Known


class _Trained(_Part):
    old_rmse: Number
    new_rmse: Number


class _Tracking(_Part):
    before: _Error
    after: _Error
    ratio: Positive | None
    ratio_interval: Annotated[list[Number], Field(min_length=2, max_length=2)] | None
    retrain: _Trained


class _Line(_Part):
    name: str
    kind: Literal["effect", "pair", "none", "outside"]
    plant: str
    nats: Known = None
    hidden: list[str]
    verdict: str
    right: bool
    partial: bool
    named: list[str]
    classed: list[str] = Field(alias="class")
    named_intervals: list[_Held]
    fitted_intervals: list[_Held] = []
    beliefs: list[_Belief] = []
    closed: Known
    closed_by_own_floor: Known = None
    shows: bool | None = None
    seconds: Known
    commit: str = ""
    error: str = ""
    tracking: _Tracking | None = None
    tracking_error: str | None = None


def read_lines(out: Path) -> list[dict[str, Any]]:
    """Every whole line of a run so far, the newest of each case last.

    Raises UnusableInput for a line that no run has written.
    """
    lines = read_json_lines(out / LINES)
    for number, line in enumerate(lines, 1):
        try:
            _Line.model_validate(line)
        except ValidationError as error:
            raise UnusableInput(
                f"{out / LINES}: whole line {number}: {first_problem(error)}; take it out to have"
                " its case done again."
            ) from error
    return lines
