"""A model that is kept from the past of some channels cannot have used it."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from trainers.build import ARCHITECTURES, build
from trainers.inspection.lockstep import Lockstep
from trainers.model import Predictor
from trainers.present_only import CODE, present_only
from trainers.training.trainer import configure, settings_for, train
from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.manifest import PARAMETER_BUDGET

INPUTS, OUTPUTS, HIDDEN = 4, 2, (1, 3)
WITH_MEMORY = [name for name in ARCHITECTURES if name != "agile-mlp"]


def predictor(arch: str) -> Predictor:
    core = build(arch, inputs=INPUTS, outputs=CODE, window_s=1.0, rate_hz=30.0, hyper={}, seed=1)
    core = present_only(core, HIDDEN, INPUTS, OUTPUTS, seed=1)
    return Predictor(arch, core, INPUTS, OUTPUTS).eval()


@pytest.mark.parametrize("arch", WITH_MEMORY)
def test_only_the_shown_channels_past_and_the_present_matter(arch: str) -> None:
    made = predictor(arch)
    assert made.trainable < PARAMETER_BUDGET
    generator = torch.Generator().manual_seed(0)
    seen = torch.randn(1, 60, INPUTS, generator=generator)
    other = seen.clone()
    other[:, :-1, list(HIDDEN)] = torch.randn(1, 59, len(HIDDEN), generator=generator)
    with torch.no_grad():
        told, told_other = made.rollout(seen)[0, -1], made.rollout(other)[0, -1]
        assert torch.equal(told, told_other)  # the hidden channels' past is not seen
        other[:, -1, HIDDEN[0]] += 1.0
        assert not torch.equal(told, made.rollout(other)[0, -1])  # their present is
        shown = seen.clone()
        shown[:, :-1, 0] += 1.0
        assert not torch.equal(told, made.rollout(shown)[0, -1])  # and the others' past


@pytest.mark.parametrize("arch", ["gru", "history-mlp"])
def test_steps_are_whole_rollouts(arch: str) -> None:
    made = predictor(arch)
    observed = np.random.default_rng(0).normal(size=(50, 2, INPUTS))
    flown = Lockstep(made)
    told = np.stack([flown(now) for now in observed], axis=1)
    with torch.no_grad():
        whole = made.rollout(torch.tensor(observed.swapaxes(0, 1).copy(), dtype=torch.float32))
    assert told == pytest.approx(whole.numpy(), abs=1e-5)


@pytest.mark.whole
def test_a_force_that_follows_a_hidden_past_cannot_be_learned(tmp_path) -> None:
    data = two_channels()
    rmse = {}
    for hidden in ((), ("own",), ("source",)):
        settings = settings_for("history-mlp", epochs=40)
        config = configure(
            data, "history-mlp", seed=0, lead_s=0.0, settings=settings, present_only=hidden
        )
        run = train(config, data, tmp_path / "-".join(hidden or ("all",)))
        rmse[hidden] = run.metrics.test.rmse["force"]
    spread = float(np.concatenate([e.force for e in data.part("test")]).std())
    assert rmse[()] < 0.3 * spread
    assert rmse[("source",)] < 0.3 * spread  # the force has nothing to do with that one's past
    assert rmse[("own",)] > 0.8 * spread


def test_what_cannot_be_hidden_is_refused() -> None:
    with pytest.raises(UnusableInput, match="no channel moon"):
        configure(two_channels(), "gru", seed=0, lead_s=0.0, present_only=("moon",))
    plain = build("agile-mlp", inputs=2, outputs=CODE, window_s=1.0, rate_hz=30.0, seed=0)
    with pytest.raises(UnusableInput, match="without memory"):
        present_only(plain, (0,), 2, 1, seed=0)
    wide = build("tcn", inputs=2, outputs=CODE, window_s=1.0, rate_hz=30.0, seed=0,
                 hyper={"channels": 46})  # fmt: skip
    with pytest.raises(UnusableInput, match="budget"):
        present_only(wide, (0,), 2, 1, seed=0)


def two_channels() -> EpisodeSet:
    """The force is what "own" was three samples ago; "source" is noise."""
    rng = np.random.default_rng(3)
    episodes = []
    for i in range(6):
        seen = rng.normal(size=(400, 2)).astype(np.float32)
        force = np.concatenate([np.zeros((3, 1), np.float32), seen[:-3, 1:]])
        episodes.append(Episode(f"e{i}", seen, force))
    split = {f"e{i}": ("train", "train", "train", "train", "validation", "test")[i]
             for i in range(6)}  # fmt: skip
    return EpisodeSet("toy", 30.0, (Channel("source", "1"), Channel("own", "1")),
                      (Channel("force", "N"),), 0.5, (1.0,), split, tuple(episodes))  # fmt: skip


@pytest.mark.whole
def test_a_reservoir_without_the_hidden_past_is_solved_like_any_other(tmp_path) -> None:
    """The force is the past of "own", which only the others may see; then its square, at once."""
    rmse = {}
    for hidden in ((), ("own",), ("source",)):
        config = configure(two_channels(), "esn", seed=0, lead_s=0.0, present_only=hidden,
                           hyper={"neurons": 200, "input_scale": 0.03})  # fmt: skip
        run = train(config, two_channels(), tmp_path / "-".join(hidden or ("all",)))
        assert run.metrics.epochs == 1  # solved, not descended
        rmse[hidden] = run.metrics.test.rmse["force"]
    assert rmse[("source",)] < 0.5
    assert rmse[()] < 0.5
    assert rmse[("own",)] > 0.9
    data = two_channels()
    now = tuple(replace(e, force=e.observation[:, 1:] ** 2) for e in data.episodes)
    data = replace(data, episodes=now)
    config = configure(data, "esn", seed=0, lead_s=0.0, present_only=("own",))
    spread = float(np.concatenate([e.force for e in data.part("test")]).std())
    assert train(config, data, tmp_path / "now").metrics.test.rmse["force"] < 0.2 * spread
