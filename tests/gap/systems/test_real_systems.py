"""Real recordings: the textbook system without what the literature says that it lacks."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from wakedeploy.core.recording import Recording
from wakedeploy.gap.search.rounds import fitted_base, named, shown_document, verdict_of
from wakedeploy.gap.systems.files import read_system
from wakedeploy.gap.systems.logs import LogModel

EXAMPLES = Path(__file__).parents[3] / "examples" / "systems"


@pytest.mark.slow
def test_the_positioning_system_lacks_coulomb_and_viscous_friction(recordings):
    raw = loadmat(recordings("emps") / "DATA_EMPS.mat")
    time_s = np.arange(raw["t"].size) * 1e-3
    columns = {"voltage_v": raw["vir"].ravel(), "position_m": raw["qm"].ravel()}
    system = read_system(EXAMPLES / "emps.py")
    model = LogModel(system, [Recording("emps", time_s, columns)])
    told = named(model, fitted_base(model))
    assert verdict_of(told) == "named"
    assert set(told.found.hypothesis) == {
        "coulomb-friction@speed_mps",
        "viscous-friction@speed_mps",
    }
    low, high = told.found.interval("coulomb-friction@speed_mps.force")
    assert low < 20.4 < high  # Janot, Gautier and Brunot (2019)
    low, high = told.found.interval("viscous-friction@speed_mps.coefficient")
    assert low < 203.5 < high
    assert shown_document(model, told)["removed"]["low"] > 0.9
