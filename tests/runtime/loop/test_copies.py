"""Copies of what a tick carries, against `dataclasses.replace`."""

import dataclasses

import numpy as np
import pytest

from runtime.loop import copies
from runtime.loop.controller import Command
from runtime.loop.estimate import initial_estimate
from runtime.loop.forecasting import Prediction
from runtime.loop.safety import Event, SafetyState, happened


@dataclasses.dataclass(frozen=True, slots=True)
class One:
    """A record of a single field."""

    value: float


@pytest.mark.parametrize(
    ("record", "changes"),
    [
        (initial_estimate(1.5), {"height": np.ones(3), "noise_scale": 3.0}),
        (Command(1000.0, 1500.0, 0.1), {"carriage_mps": 0.0}),
        (Prediction(0.3), {"doubted": True}),
        (SafetyState(), {}),
        (One(1.0), {"value": 2.0}),
    ],
)
def test_a_copy_is_that_of_the_standard_library(record, changes):
    ours, theirs = copies.replace(record, **changes), dataclasses.replace(record, **changes)
    assert type(ours) is type(record)
    for field in dataclasses.fields(record):
        assert getattr(ours, field.name) is getattr(theirs, field.name), field.name
    assert ours is not record


def test_an_unknown_field_is_refused_and_the_copy_is_frozen():
    with pytest.raises(TypeError, match="Command has no field 'sufferer'"):
        copies.replace(Command(1000.0, 1500.0, 0.1), sufferer=1.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        copies.replace(One(1.0)).value = 2.0


def test_an_event_that_changes_nothing_costs_no_copy():
    state = SafetyState()
    assert happened(state, Event.DISARM) is state
