"""Where a fit computes: on the CPU, or on CUDA where torch sees it and the work is worth it."""

import contextlib
from collections.abc import Iterator

import torch

from trainers.model import Predictor, SolvedModel
from trainers.training.fit import FitSettings
from wakedeploy.core.errors import UnusableInput

DEVICES = ("auto", "cpu", "cuda")

# Samples × weights of one update, below which a fit stays on the CPU. An update launches some
# hundred kernels, which takes a GPU several milliseconds whatever their size; a CPU core does about
# this many multiply-adds in that time. An estimate: no GPU was at hand to measure it. With the
# usual batches no model within the parameter budget reaches it, except for a reservoir of thousands
# of neurons.
CUDA_PAYS_FROM = 2e8

_SOLVED_LANES = 32  # a solved core is played step by step, this many episodes side by side


def choose_device(asked: str, predictor: Predictor, settings: FitSettings) -> str:
    """Where a fit computes: CUDA by itself only if torch sees it and one update is large enough.

    `asked` is "auto", "cpu" or "cuda"; the answer is "cpu" or "cuda".
    Raises UnusableInput where CUDA is asked for and torch does not see it.
    """
    if not isinstance(asked, str):  # as a torch.device, which is not equal to its name
        kind = type(asked).__name__
        raise UnusableInput(f"device is a {kind}; give text: {', '.join(DEVICES)}.")
    if asked not in DEVICES:
        raise UnusableInput(f"There is no device '{asked}'; choose {', '.join(DEVICES)}.")
    if asked == "cuda":
        require_cuda()
    if asked != "auto":
        return asked
    pays = work_of_update(predictor, settings) >= CUDA_PAYS_FROM
    return "cuda" if pays and torch.cuda.is_available() else "cpu"


def require_cuda() -> None:
    """Raise UnusableInput where torch does not see CUDA."""
    if not torch.cuda.is_available():
        raise UnusableInput("torch sees no CUDA device here; choose --device auto or cpu.")


def work_of_update(predictor: Predictor, settings: FitSettings) -> float:
    """Samples that one update takes at once, times all weights.

    These are its multiply-adds if each weight is used once per sample; a convolution or attention
    over a window uses some of them more often.
    """
    if isinstance(predictor.core, SolvedModel):
        samples = _SOLVED_LANES
    elif predictor.memory.kind == "state":
        samples = settings.lanes * settings.chunk_steps
    else:
        samples = settings.batch
    return float(samples) * (predictor.trainable + predictor.frozen)


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Let torch compute on one CPU thread for a while, so that a seed gives the same result."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
