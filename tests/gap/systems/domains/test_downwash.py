"""The 2D simulator: the sufferer's wake is that of its hypothesis, and the hidden lag is named."""

import numpy as np
import pytest

from wakedeploy.core.errors import UnusableInput
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import rank
from wakedeploy.gap.systems.domains.downwash import HIDDEN, fly, open_model, wake_force_n


def test_the_measured_force_is_the_hidden_worlds_with_noise():
    model = fly(HIDDEN, flights=2)
    true_n = wake_force_n(model.way, HIDDEN)
    wrong_n = wake_force_n(model.way, {})
    measured_n = np.stack([r.measured[0] for r in model.records], axis=1)
    assert (measured_n - true_n).std() == pytest.approx(0.05, rel=0.3)
    assert (measured_n - wrong_n).std() > 1.2 * (measured_n - true_n).std()


def test_a_step_of_the_source_arrives_after_separation_over_speed():
    model = fly({}, flights=1)
    model.way.source_n[:] = 10.0
    model.way.source_n[125:] = 14.0
    model.way.x_m[:], model.way.z_m[:] = 0.0, -1.8
    force_n = wake_force_n(model.way, {})[:, 0]
    before, after = force_n[120], force_n[-1]
    halfway = np.flatnonzero(force_n < 0.5 * (before + after))[0]
    assert (halfway - 125) * 0.04 == pytest.approx(1.8 / 6.0, abs=0.05)


def test_a_path_is_refused(tmp_path):
    with pytest.raises(UnusableInput, match="leave the path out"):
        open_model(tmp_path)


@pytest.mark.slow
def test_the_hidden_spool_lag_is_named():
    model = fly(HIDDEN)
    base = fit(model, (), range(model.episodes))
    best = rank(model, base, ("command-latency", "transport-speed", "spool-lag"))[0]
    assert best.name == "spool-lag"
    for name, true_s in HIDDEN.items():
        low, high = best.fit.interval(name, 0.99)
        assert low < true_s < high
