"""Episodes laid end to end on one tape: windows are views and lanes indices, not copies."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from trainers.training.targets import shift_ahead
from wakedeploy.core.episodes import Array, Episode, EpisodeSet
from wakedeploy.core.errors import UnusableInput


@dataclass(frozen=True, eq=False)
class Tape:
    """N samples of some episodes, end to end.

    Shapes: observation (N, d), force (N, o) `lead_s` later, first (N,) index of the first sample
    of each sample's episode, scored (N,) whether it lies after the common warm-up. `names` and
    `lengths` are those of the episodes, in order.
    """

    observation: Tensor
    force: Tensor
    first: Tensor
    scored: Tensor
    lengths: tuple[int, ...]
    names: tuple[str, ...]

    @property
    def starts(self) -> list[int]:
        """Index of each episode's first sample."""
        return [0, *np.cumsum(self.lengths)[:-1].tolist()]

    def to(self, device: str) -> "Tape":
        """The tape with its tensors on a device, where all indices into it are made too."""
        return Tape(
            observation=self.observation.to(device),
            force=self.force.to(device),
            first=self.first.to(device),
            scored=self.scored.to(device),
            lengths=self.lengths,
            names=self.names,
        )


def tape_of(series: Array, outputs: int) -> Tape:
    """Series (B, T, d) of observations alone: none is scored, and forces (B · T, o) are 0."""
    count, steps, inputs = series.shape
    return Tape(
        observation=torch.tensor(series).reshape(count * steps, inputs),
        force=torch.zeros(count * steps, outputs),
        first=torch.arange(count).repeat_interleave(steps) * steps,
        scored=torch.zeros(count * steps, dtype=torch.bool),
        lengths=(steps,) * count,
        names=("",) * count,
    )


@dataclass(frozen=True)
class Chunk:
    """What a step of truncated backpropagation sees of every lane.

    Shapes: index (B, L) into the tape, scored (B, L), fresh (B,) where a lane's state starts anew.
    """

    index: Tensor
    scored: Tensor
    fresh: Tensor


def lay_tape(data: EpisodeSet, split: str, lead_s: float, warm_up: int) -> Tape:
    """The samples of one split that have a target, scored from sample `warm_up` of each episode.

    Raises UnusableInput when no sample is left after warm-up and lead.
    """
    every = [(e.name, *_with_target(e, lead_s, data.rate_hz)) for e in data.part(split)]
    parts = [part for part in every if len(part[2]) > warm_up]
    if not parts:
        raise _too_short(data, split, lead_s, warm_up)
    names, observations, forces = zip(*parts, strict=True)
    lengths = tuple(map(len, forces))
    first = torch.tensor(np.repeat(np.cumsum((0, *lengths[:-1])), lengths))
    return Tape(
        observation=torch.tensor(np.concatenate(observations)),
        force=torch.tensor(np.concatenate(forces)),
        first=first,
        scored=torch.arange(len(first)) - first >= warm_up,
        lengths=lengths,
        names=names,
    )


def scored_samples(data: EpisodeSet, split: str, lead_s: float, warm_up: int) -> int:
    """How many samples of a split are scored after `warm_up` samples of each episode and lead."""
    lengths = (len(shift_ahead(e.force, lead_s, data.rate_hz)) for e in data.part(split))
    return sum(max(0, length - warm_up) for length in lengths)


def _too_short(data: EpisodeSet, split: str, lead_s: float, warm_up: int) -> UnusableInput:
    """The sentence for a split of which warm-up and lead leave nothing."""
    if not data.part(split):
        return UnusableInput(
            f"This {data.domain} set has no episode in its '{split}' split; assign one to it."
        )
    longest = max(map(len, data.part(split)))
    if longest > warm_up:
        shorter = "a smaller lead"
    else:
        shorter = "a shorter history_s" if warm_up > data.warm_up_steps else "a shorter window_s"
    lead = f" plus a lead of {lead_s:g} s" if lead_s > 0 else ""
    return UnusableInput(
        f"The '{split}' split of this {data.domain} set has no episode longer than its warm-up of"
        f" {warm_up} samples{lead}, the longest has {longest}; record longer episodes or choose"
        f" {shorter}."
    )


def _with_target(episode: Episode, lead_s: float, rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    force = shift_ahead(episode.force, lead_s, rate_hz)
    return episode.observation[: len(force)], force


def shuffled(tape: Tape, generator: torch.Generator) -> Tensor:
    """The scored samples in random order: (M,)."""
    scored = torch.nonzero(tape.scored).squeeze(1)
    order = torch.randperm(len(scored), generator=generator)
    return scored[order.to(scored.device)]


def lanes(
    tape: Tape, *, count: int, steps: int, warm_up: int, generator: torch.Generator
) -> Iterator[Chunk]:
    """Whole episodes, in random order, played side by side in `count` lanes, `steps` at a time.

    A lane runs on through its episodes; its state is `fresh` where an episode begins and at the
    lane's own beginning, and nothing is scored until `warm_up` samples later. Chunk borders move
    from epoch to epoch.
    """
    pieces = _pieces(tape, steps, generator)
    count = min(count, len(pieces))
    unscored = warm_up // steps  # chunks at a lane's beginning; fewer lanes where all would be
    if -(-len(pieces) // count) <= unscored:
        count = max(1, len(pieces) // (unscored + 1))
    per_lane = -(-len(pieces) // count)
    rows = [_lane(pieces[i * per_lane : (i + 1) * per_lane], per_lane) for i in range(count)]
    table = torch.tensor(
        rows, device=tape.first.device
    )  # (B, M, 4): start, end, fresh, where the state was last fresh
    for start, end, fresh, since in table.permute(1, 2, 0):
        index = start.unsqueeze(1) + torch.arange(steps, device=start.device)  # (B, L)
        scored = (index < end.unsqueeze(1)) & (index >= (since + warm_up).unsqueeze(1))
        yield Chunk(torch.minimum(index, end.unsqueeze(1) - 1), scored, fresh.bool())


def _pieces(tape: Tape, steps: int, generator: torch.Generator) -> list[tuple[int, int, bool]]:
    """(start, end of its episode, whether it begins it) for every chunk, episodes shuffled."""
    starts = tape.starts
    pieces = []
    for episode in torch.randperm(len(starts), generator=generator).tolist():
        length, start = tape.lengths[episode], starts[episode]
        phase = int(torch.randint(max(1, min(steps, length - steps)), (), generator=generator))
        for offset in range(phase, length, steps):
            pieces.append((start + offset, start + length, offset == phase))
    return pieces


def _lane(pieces: Sequence[tuple[int, int, bool]], length: int) -> list[list[int]]:
    """One lane's rows, filled up with chunks that are never scored."""
    rows: list[list[int]] = []
    since = 0
    for start, end, begins in pieces:
        fresh = begins or not rows
        since = start if fresh else since
        rows.append([start, end, int(fresh), since])
    nothing = [0, 1, 1, 1]  # its last usable sample comes before anything is scored
    return rows + [nothing] * (length - len(rows))
