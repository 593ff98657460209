"""What the steps' artefacts have to be, as far as code goes by it; numbers may be null.

In: an artefact as JSON gives it. Out: nothing, or what is wrong with it. Pages show whatever else
an artefact says as far as it can be shown (`wording`); rig files are written from what is checked
here.
"""

from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from wakedeploy.core.validation import first_problem

_LARGEST = 1e15  # in any unit, nothing that was measured is so large
Number = Annotated[float, Field(ge=-_LARGEST, le=_LARGEST)]


class _Part(BaseModel):
    """It may say more than what is asked for."""

    model_config = ConfigDict(strict=True, extra="allow")


class _Size(_Part):
    value: Number | None = None
    low: Number | None = None
    high: Number | None = None
    unit: str | None = None


class _Effect(_Part):
    name: str
    parameters: dict[str, _Size] = {}


class _Place(_Part):
    channel: str | None = None
    coordinate: str | None = None
    q_value: Number | None = None


class _Log(_Part):
    path: str | None = None
    sha256: str | None = None


class _Find(_Part):
    rig: str | None = None
    rig_sha256: str | None = None
    logs: list[_Log] = []
    places: list[_Place] = []


class _Round(_Part):
    given: list[str] = []
    ranking: list[_Effect] = []


class _Unknown(_Part):
    expression: str | None = None
    parameters: dict[str, _Size] = {}


class _Name(_Part):
    verdict: str | None = None
    effects: list[_Effect] = []
    classed: list[str] = Field(default=[], alias="class")
    rounds: list[_Round] = []
    together: list[_Effect] = []
    beside: list[_Effect] = []
    unknown: _Unknown | None = None


class _Add(_Part):
    effects: list[_Effect] = []
    new_sha256: str | None = None


class _Show(_Part):
    gap: dict[str, dict[str, Any]] = {}


class _Result(_Part):
    verdict: str | None = None
    classed: list[str] = Field(default=[], alias="class")


class _Plan(_Part):
    classed: list[str] = Field(default=[], alias="class")


_KINDS: Mapping[str, type[_Part]] = {
    "find": _Find,
    "name": _Name,
    "add": _Add,
    "show": _Show,
    "result": _Result,
    "plan": _Plan,
}


def problem_of(step: str, content: Mapping[str, Any]) -> str | None:
    """The first thing in an artefact that no step has written, in a clause; None without any."""
    try:
        _KINDS[step].model_validate(content)
    except ValidationError as error:
        return first_problem(error)
    return None
