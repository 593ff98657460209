"""What a search writes of the constants that it fitted."""

from types import SimpleNamespace

import pytest

from wakedeploy.gap.evidence.fits import Free
from wakedeploy.gap.search.results import constants_of


@pytest.mark.parametrize(
    ("spread", "low", "high"), [(0.3, 2.507, 3.493), (float("inf"), 0.0, 2713.0)]
)
def test_no_interval_of_a_constant_is_wider_than_what_was_stated(spread, low, high):
    """Blocks that stand still said 3 N m (0 to 2,713) of a weight that is known to a tenth."""
    free = Free("constant.weight_nm", "N m", 3.3, spread, 0.0, 1e4, 1e-3)
    fitted = SimpleNamespace(
        free=[free], value=lambda name: 3.0, interval=lambda name: (0.0, 2713.0)
    )
    size = constants_of(fitted)["weight_nm"]
    assert (size.low, size.high) == pytest.approx((low, high), abs=1e-3)
