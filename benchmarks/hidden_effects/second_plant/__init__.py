"""A second gantry plant, written from equations and importing nothing of the project.

In: numbers as plain floats, pulse widths, carriage speed. Out: motion and readings. It stands
beside the plant that the workflow's own model was written from, so that the workflow is judged on
a world it cannot have been fitted to: another wake model, another integrator, other friction.
May import numpy and numba.
"""

from .constants import Constants, Curve, Numbers, Sensing, Wake
from .jet import Jet, calibrated_jet, field_response
from .plant import Sample, SecondPlant

__all__ = [
    "Constants",
    "Curve",
    "Jet",
    "Numbers",
    "Sample",
    "SecondPlant",
    "Sensing",
    "Wake",
    "calibrated_jet",
    "field_response",
]
