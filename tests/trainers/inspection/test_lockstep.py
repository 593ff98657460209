"""A predictor flown step by step says what it says over whole recordings."""

import numpy as np
import pytest
import torch

from trainers.build import ARCHITECTURES, build
from trainers.inspection.lockstep import Lockstep
from trainers.model import Predictor

STEPS, EPISODES, INPUTS, OUTPUTS = 120, 3, 4, 2


@pytest.mark.parametrize("arch", list(ARCHITECTURES))
def test_steps_side_by_side_are_whole_rollouts(arch: str) -> None:
    core = build(arch, inputs=INPUTS, outputs=OUTPUTS, window_s=1.0, rate_hz=60.0, hyper={}, seed=1)
    predictor = Predictor(arch, core, INPUTS, OUTPUTS)
    rng = np.random.default_rng(0)
    observed = np.cumsum(rng.normal(0, 0.2, (STEPS, EPISODES, INPUTS)), axis=0)
    flown = Lockstep(predictor)
    told = np.stack([flown(now) for now in observed], axis=1)  # (E, T, o)
    with torch.no_grad():
        whole = predictor.eval().rollout(
            torch.as_tensor(observed.swapaxes(0, 1).copy(), dtype=torch.float32)
        )
    scale = float(whole.abs().max())
    assert told == pytest.approx(whole.numpy(), abs=1e-5 * scale)
