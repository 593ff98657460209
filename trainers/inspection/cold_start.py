"""A predictor whose past ends: every force from a state that began anew some samples before.

In: a trained predictor, a tape, and how many samples of the past it may see. Out: forces that no
older sample has any part in.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from trainers.model import Predictor
from trainers.training.tape import Tape

_SAMPLES_AT_ONCE = 65_536  # bounds memory, does not change the result


@torch.no_grad()
def predict_from_cold(
    predictor: Predictor, tape: Tape, newest: NDArray[np.int64], past: int
) -> Tensor:
    """Forces (M, o) in SI at the tape's samples `newest` (M,), seeing `past` samples before each.

    Raises ValueError where the past begins before the sample's episode.
    """
    at = torch.as_tensor(newest)  # (M,)
    if past < 0 or bool((at - past < tape.first[at]).any()):
        raise ValueError(f"past = {past}: an episode has fewer samples before one that is asked")
    was_training = predictor.training
    predictor.eval()
    ages = torch.arange(past, -1, -1)  # (P,)
    forces = []
    for block in at.split(max(1, _SAMPLES_AT_ONCE // (past + 1))):  # type: ignore[no-untyped-call]
        windows = tape.observation[block.unsqueeze(1) - ages]  # (B, P, d)
        forces.append(predictor.rollout(windows)[:, -1])
    predictor.train(was_training)
    return torch.cat(forces)
