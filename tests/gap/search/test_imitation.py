"""Where candidates begin beside the best one, on a model with closed forms."""

import numpy as np
import pytest

from tests.gap.linear_model import EPISODES, Linear
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.search.imitation import doing_alike

START = 0.5  # the model's usual size of each effect


def test_what_is_alike_begins_at_the_size_that_does_as_much():
    """By least squares; what does nothing alike stays at its usual size, and costs no more."""
    model = Linear({"a": 0.6})
    base, best = (fit(model, h, range(EPISODES)) for h in ((), ("a",)))
    model.scored.clear()
    begun = doing_alike(model, base, best, [("b",), ("c",), ("b", "c")])
    a, b, c = (model.columns[name].ravel() for name in "abc")
    weight = 1.0 / model.variance.ravel()
    size = best.value("a.size") * (weight * a) @ b / ((weight * b) @ b)
    assert begun[("b",)].value("b.size") == pytest.approx(size, rel=1e-6)
    assert begun[("c",)].value("c.size") == START
    both = np.column_stack([b, c]) * np.sqrt(weight)[:, None]
    sizes = np.linalg.lstsq(both, best.value("a.size") * a * np.sqrt(weight), rcond=None)[0]
    found = begun["b", "c"]
    assert [found.value(f"{n}.size") for n in "bc"] == pytest.approx(sizes, rel=1e-6)
    for fitted in begun.values():  # constants are as they are beside the best one
        assert fitted.theta[:2] == pytest.approx(best.theta[:2])
    alone = [theta for theta in model.scored if len(theta) == 3 and theta[2] == START]
    assert len(alone) == 2 * EPISODES
