"""A rejected document's first problem, in words that are not pydantic's."""

from typing import Literal

import pydantic
import pytest

from wakedeploy.core.validation import first_problem


class _Plan(pydantic.BaseModel):
    model_config = pydantic.ConfigDict(strict=True)

    seeds: int = pydantic.Field(1, ge=1)
    lead_s: float = pydantic.Field(0.1, gt=0.0, allow_inf_nan=False)
    kind: Literal["here", "cluster"] = "here"
    sets: list[str] = []
    is_kept: bool = True
    name: str = ""
    settings: dict[str, float] = {}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"seeds": 0}, "seeds = 0: it has to be at least 1"),
        ({"seeds": "three"}, "seeds = 'three': it has to be a whole number"),
        ({"lead_s": -0.1}, "lead_s = -0.1: it has to be above 0"),
        ({"lead_s": float("inf")}, "lead_s = inf: it has to be a finite number"),
        ({"kind": "there"}, "kind = 'there': it has to be 'here' or 'cluster'"),
        ({"sets": "a"}, "sets = 'a': it has to be a list"),
        ({"sets": [3]}, "sets.0 = 3: it has to be text"),
        ({"is_kept": 3}, "is_kept = 3: it has to be true or false"),
        ({"settings": 3}, "settings = 3: it has to be a table"),
    ],
)
def test_a_value_of_another_kind_is_told_in_plain_words(given: dict[str, object], said: str):
    with pytest.raises(pydantic.ValidationError) as caught:
        _Plan.model_validate(given)
    assert first_problem(caught.value) == said
