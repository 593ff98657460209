"""Runs: resumed, finished, refused; and memory that pays where the force is an echo."""

import dataclasses
import json
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors import SafetensorError

from trainers.trained_run import TrainedRun, load_run
from trainers.training import runs
from trainers.training.fit import FitSettings, learning_rate
from trainers.training.loss import WeightedMse
from trainers.training.runs import (
    CONFIG,
    TRAINING,
    RunConfig,
    finished_runs,
    read_tensors,
    runs_of,
    write_tensors,
)
from trainers.training.score import score
from trainers.training.trainer import chosen_lead_s, configure, require_enough, settings_for, train
from wakedeploy.core.episodes import Channel, EpisodeSet
from wakedeploy.core.errors import UnusableInput

SHORT = FitSettings(epochs=5, lanes=4, chunk_steps=32)
# Validation losses of each revision after two epochs, of one force and of two. Where they change,
# so do all weights: raise TRAINING, so that runs of the code before are not taken for runs of this.
ENDS = {
    2: {
        "agile-mlp": (0.48500, 0.51538), "history-mlp": (0.13027, 0.19348),
        "delay-embedding": (0.14833, 0.19275), "gru": (0.13513, 0.18836), "tcn": (0.08296, 0.14040),
        "mamba": (0.46716, 0.54797), "esn": (0.06615, 0.05841),
        "cross-attention": (0.30459, 0.33768),
    }
}  # fmt: skip
SMALL = {"gru": {"hidden": 16, "dropout": 0.2}, "esn": {"neurons": 80}, "tcn": {"channels": 8}}


def with_a_moment(data: EpisodeSet) -> EpisodeSet:
    """The set with a second force, the product of both inputs, which counts a quarter."""
    episodes = tuple(
        dataclasses.replace(
            one, force=np.hstack([one.force, 0.02 * one.observation.prod(1, keepdims=True)])
        )
        for one in data.episodes
    )
    force = (*data.force, Channel("m_n_m", "N·m"))
    return dataclasses.replace(data, force=force, loss_weights=(1.0, 0.25), episodes=episodes)


def trained(
    data: EpisodeSet, root: Path, arch: str, settings: FitSettings | None = SHORT, **others
) -> TrainedRun:
    asked = {"seed": 0, "lead_s": 0.0, "hyper": SMALL.get(arch), "settings": settings} | others
    keep = {name: asked.pop(name) for name in ("on_epoch", "fresh", "device") if name in asked}
    return train(configure(data, arch, **asked), data, root, **keep)


def interrupt_after(epoch: int) -> Callable[[int, int], None]:
    def on_epoch(done: int, total: int) -> None:
        if done == epoch:
            raise KeyboardInterrupt

    return on_epoch


@pytest.mark.parametrize("arch", ["gru", "tcn", "mamba", "history-mlp", "delay-embedding"])
def test_a_resumed_run_ends_exactly_like_an_uninterrupted_one(
    arch: str, echo: EpisodeSet, tmp_path: Path
) -> None:
    whole = trained(echo, tmp_path / "whole", arch)
    torch.rand(7)  # nothing may hang on torch's own generator
    for stop in (1, 3):
        with pytest.raises(KeyboardInterrupt):
            trained(echo, tmp_path / "cut", arch, on_epoch=interrupt_after(stop))
    resumed = trained(echo, tmp_path / "cut", arch)
    for name, value in whole.predictor.state_dict().items():
        assert torch.equal(value, resumed.predictor.state_dict()[name]), name
    assert whole.metrics.history == resumed.metrics.history
    assert whole.metrics.test == resumed.metrics.test


def test_a_force_that_never_changes_is_refused_by_its_name(echo: EpisodeSet) -> None:
    still = tuple(dataclasses.replace(e, force=np.ones_like(e.force)) for e in echo.episodes)
    data = dataclasses.replace(echo, episodes=still)
    with pytest.raises(UnusableInput, match=r"force f_n is 1 N in all training episodes"):
        configure(data, "agile-mlp", seed=0, lead_s=0.0)


@pytest.mark.parametrize("split", ["validation", "test"])
def test_a_copy_of_a_training_episode_is_no_test_of_it(echo: EpisodeSet, split: str) -> None:
    learned = echo.part("train")[1]
    copied = dataclasses.replace(echo.part(split)[0], observation=learned.observation.copy(),
                                 force=learned.force.copy())  # fmt: skip
    episodes = tuple(copied if e.name == copied.name else e for e in echo.episodes)
    says = f"the {split} episode {copied.name} is the train episode {learned.name}, sample by"
    with pytest.raises(UnusableInput, match=says):
        require_enough(dataclasses.replace(echo, episodes=episodes), lead_s=0.0)


def scaled(data: EpisodeSet, kind: str, factor: float) -> EpisodeSet:
    """The set with all numbers of observations, or of forces, times a factor."""
    episodes = [
        dataclasses.replace(e, **{kind: (e.arrays[kind].astype(float) * factor).astype("f4")})
        for e in data.episodes
    ]
    return dataclasses.replace(data, episodes=tuple(episodes))


@pytest.mark.parametrize("factor", [1e-30, 1e25])
@pytest.mark.parametrize("kind", ["observation", "force"])
def test_numbers_that_float32_cannot_square_are_refused_with_another_unit(
    echo: EpisodeSet, kind: str, factor: float
) -> None:
    says = f"the {kind} .* float32 cannot square more; leave out .* another unit: to = … in columns"
    with pytest.raises(UnusableInput, match=says):
        configure(scaled(echo, kind, factor), "gru", seed=0, lead_s=0.0)


@pytest.mark.parametrize("factor", [1e-13, 1e12])  # forces change by less than 0.3
def test_up_to_the_bounds_training_comes_to_the_same(
    echo: EpisodeSet, factor: float, tmp_path: Path
) -> None:
    for arch in ("agile-mlp", "esn"):
        asked = {"seed": 0, "lead_s": 0.0, "hyper": {"neurons": 40} if arch == "esn" else {}}
        usual, far = (
            train(
                configure(data, arch, settings=settings_for(arch, epochs=2), **asked),
                data, tmp_path / str(i),
            )
            for i, data in enumerate((echo, scaled(echo, "force", factor)))
        )  # fmt: skip
        assert far.metrics.test.r2["f_n"] == pytest.approx(usual.metrics.test.r2["f_n"], abs=0.01)


def test_an_interrupted_run_keeps_its_epochs_and_says_why(echo: EpisodeSet, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        trained(echo, tmp_path, "agile-mlp", on_epoch=interrupt_after(2))
    fewer = dataclasses.replace(SHORT, epochs=3)
    with pytest.raises(
        UnusableInput, match="was begun with epochs = 5, not 3: the learning"
    ) as said:
        trained(echo, tmp_path, "agile-mlp", fewer)
    assert "more of them" not in str(said.value)
    assert "(fresh=True)" in str(said.value)


def test_a_finished_run_is_not_trained_again_unless_fresh(echo: EpisodeSet, tmp_path: Path) -> None:
    first = trained(echo, tmp_path, "agile-mlp")
    epochs: list[int] = []
    again = trained(echo, tmp_path, "agile-mlp", on_epoch=lambda done, total: epochs.append(done))
    assert epochs == []
    assert again.metrics == first.metrics
    fresh = trained(
        echo, tmp_path, "agile-mlp", fresh=True, on_epoch=lambda done, total: epochs.append(done)
    )
    assert epochs == [1, 2, 3, 4, 5]
    assert fresh.metrics.weights_sha256 == first.metrics.weights_sha256


@pytest.mark.parametrize("why", ["device", "lead", "test split"])
def test_a_training_that_is_refused_costs_no_run_and_blocks_none(
    why: str, echo: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: dict[str, Any] = {"fresh": True}
    data = echo
    if why == "device":
        monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
        asked["device"] = "cuda"
    elif why == "lead":
        asked["lead_s"] = 1e4
    else:
        short = [
            dataclasses.replace(e, observation=e.observation[:5], force=e.force[:5], extras={})
            if echo.split[e.name] == "test"
            else e
            for e in echo.episodes
        ]
        data = dataclasses.replace(echo, episodes=tuple(short))
    first = trained(data if why != "test split" else echo, tmp_path, "agile-mlp")
    with pytest.raises(UnusableInput):
        trained(data, tmp_path, "agile-mlp", **asked)
    assert load_run(first.folder).metrics == first.metrics
    with pytest.raises(UnusableInput):
        trained(data, tmp_path / "other", "agile-mlp", **asked)
    trained(echo, tmp_path / "other", "agile-mlp")


def test_two_processes_that_train_the_same_train_it_once(echo: EpisodeSet, tmp_path: Path) -> None:
    epochs: list[int] = []
    with ThreadPoolExecutor(2) as pool:
        runs = [
            pool.submit(
                trained,
                echo,
                tmp_path,
                "agile-mlp",
                on_epoch=lambda done, total: epochs.append(done),
            )
            for _ in range(2)
        ]
    assert sorted(epochs) == [1, 2, 3, 4, 5]
    assert runs[0].result().metrics == runs[1].result().metrics


def test_another_configuration_or_set_is_told_in_one_sentence(
    echo: EpisodeSet, make_echo: Callable[..., EpisodeSet], tmp_path: Path
) -> None:
    trained(echo, tmp_path, "agile-mlp")
    with pytest.raises(UnusableInput, match=r"lead_s = 0\.0, not 0\.1; choose another --out"):
        trained(echo, tmp_path, "agile-mlp", lead_s=0.1)
    longer = dataclasses.replace(SHORT, epochs=9)
    with pytest.raises(UnusableInput, match="epochs = 5, not 9"):
        trained(echo, tmp_path, "agile-mlp", settings=longer)
    with pytest.raises(UnusableInput, match="trained on other data"):
        trained(make_echo(steps=200), tmp_path, "agile-mlp")


def test_a_lead_that_is_asked_for_counts_even_none_and_else_the_rigs(echo: EpisodeSet) -> None:
    rigs = dataclasses.replace(echo, provenance={"default_lead_s": 0.05})
    told = [chosen_lead_s(data, asked_s) for data in (rigs, echo) for asked_s in (None, 0.0, 0.1)]
    assert told == [0.05, 0.0, 0.1, 0.0, 0.0, 0.1]


def test_a_run_of_another_revision_of_the_code_is_told(echo: EpisodeSet, tmp_path: Path) -> None:
    first = trained(echo, tmp_path, "agile-mlp")
    told = json.loads((first.folder / CONFIG).read_text())
    assert told.pop("training") == TRAINING
    (first.folder / CONFIG).write_text(json.dumps(told))  # as the first revision wrote it
    with pytest.raises(
        UnusableInput, match=rf"by other code \(revision 1, this is {TRAINING}\); choose"
    ):
        trained(echo, tmp_path, "agile-mlp")


@pytest.mark.parametrize(
    "arch",
    [  # of each kind of memory one, and the one that is not fitted by steps
        arch
        if arch in ("history-mlp", "gru", "esn")
        else pytest.param(arch, marks=pytest.mark.slow)
        for arch in ENDS[TRAINING]
    ],
)
def test_fits_end_where_this_revision_ends(arch: str, echo: EpisodeSet, tmp_path: Path) -> None:
    """To 0.1 %: machines differ by less, every change of what is fitted by more."""
    settings = dataclasses.replace(SHORT, epochs=2)
    for data, end in zip((echo, with_a_moment(echo)), ENDS[TRAINING][arch], strict=True):
        run = trained(data, tmp_path / f"{len(data.force)}", arch, settings, hyper=None)
        assert run.metrics.history[-1] == pytest.approx(end, rel=1e-3)


def test_a_run_folder_holds_safetensors_and_json_only(echo: EpisodeSet, tmp_path: Path) -> None:
    for arch in ("gru", "esn"):
        folder = trained(echo, tmp_path, arch).folder
        assert folder == tmp_path / "echo" / arch / "s0"
        assert (folder / ".turn.lock").stat().st_size == 0
        for path in (path for path in folder.iterdir() if path.name != ".turn.lock"):
            assert path.suffix in {".json", ".safetensors"}, path
            data = path.read_bytes()
            if path.suffix == ".json":
                json.loads(data)
            else:  # an eight-byte header length, then JSON: no pickle opcodes lead the file
                json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])


@pytest.mark.parametrize("file", ["best.safetensors", "config.json", "metrics.json"])
@pytest.mark.parametrize("harm", ["cut", "flip", "empty"])
def test_a_damaged_run_is_told_with_its_file(
    file: str, harm: str, echo: EpisodeSet, tmp_path: Path
) -> None:
    path = trained(echo, tmp_path, "agile-mlp").folder / file
    data = bytearray(path.read_bytes())
    if harm == "flip":
        data[len(data) // 2] ^= 0x80
    path.write_bytes({"cut": data[: len(data) // 2], "flip": data, "empty": b""}[harm])
    with pytest.raises(UnusableInput, match=rf"{file} is damaged .*--fresh") as told:
        load_run(path.parent)
    assert "\n" not in str(told.value)
    assert trained(echo, tmp_path, "agile-mlp", fresh=True).metrics.epochs == 5


def test_an_interruption_while_a_checkpoint_is_read_is_no_damage(tmp_path, monkeypatch) -> None:
    """The library turns what is raised within its own code into an error of the file."""
    write_tensors(tmp_path / "a.safetensors", {"w": torch.zeros(3)}, {})
    opened = runs.safe_open

    def interrupted(*asked: object, **others: object):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt as error:
            raise SafetensorError("no shape") from error
        return opened(*asked, **others)

    monkeypatch.setattr(runs, "safe_open", interrupted)
    with pytest.raises(KeyboardInterrupt):
        read_tensors(tmp_path / "a.safetensors")


def test_a_damaged_checkpoint_to_resume_from_is_told(echo: EpisodeSet, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        trained(echo, tmp_path, "gru", on_epoch=interrupt_after(2))
    path = tmp_path / "echo" / "gru" / "s0" / "last.safetensors"
    tensors, facts = read_tensors(path)
    write_tensors(path, tensors | {"optimiser.first": tensors["optimiser.first"][:-1]}, facts)
    with pytest.raises(UnusableInput, match="not a checkpoint of this run"):
        trained(echo, tmp_path, "gru")
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(UnusableInput, match=r"last\.safetensors is damaged"):
        trained(echo, tmp_path, "gru")
    path.write_bytes((tmp_path / "echo" / "gru" / "s0" / "best.safetensors").read_bytes())
    with pytest.raises(UnusableInput, match="not a checkpoint of this run"):
        trained(echo, tmp_path, "gru")


def test_an_unfinished_run_cannot_be_used(echo: EpisodeSet, tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        trained(echo, tmp_path, "gru", on_epoch=interrupt_after(2))
    with pytest.raises(UnusableInput, match="finish it with `wakedeploy train`"):
        load_run(tmp_path / "echo" / "gru" / "s0")
    with pytest.raises(UnusableInput, match="no finished run"):
        finished_runs(tmp_path)


def test_runs_are_found_the_newest_last(echo: EpisodeSet, tmp_path: Path) -> None:
    trained(echo, tmp_path, "agile-mlp", seed=1)
    trained(echo, tmp_path, "agile-mlp", seed=0)
    trained(echo, tmp_path, "history-mlp", seed=2)
    own = [tmp_path / "echo" / "agile-mlp" / seed for seed in ("s1", "s0")]
    assert runs_of(tmp_path, "agile-mlp") == own
    assert runs_of(tmp_path) == [*own, tmp_path / "echo" / "history-mlp" / "s2"]
    with pytest.raises(UnusableInput, match="no finished run of gru"):
        runs_of(tmp_path, "gru")


def test_a_configuration_survives_its_file(echo: EpisodeSet) -> None:
    config = configure(echo, "delay-embedding", seed=3, lead_s=0.09, hyper={"initial_delay_s": 0.2})
    assert RunConfig.model_validate_json(config.model_dump_json()) == config
    observed = np.concatenate([e.observation for e in echo.part("train")])
    assert [c.min for c in config.observation] == pytest.approx(observed.min(0).tolist())
    assert [c.max for c in config.observation] == pytest.approx(observed.max(0).tolist())


@pytest.mark.whole
def test_memory_beats_the_memoryless_where_the_force_is_an_echo(
    make_echo: Callable[..., EpisodeSet], tmp_path: Path
) -> None:
    data = make_echo(steps=900, episodes=8)
    r2 = {}
    for arch in ("agile-mlp", "history-mlp", "delay-embedding", "gru", "esn"):
        settings = dataclasses.replace(settings_for(arch, epochs=14), lanes=8, chunk_steps=32)
        hyper = {"gru": {"hidden": 32}, "esn": {"neurons": 300}}.get(arch)
        run = trained(data, tmp_path, arch, settings=settings, hyper=hyper)
        r2[arch] = run.metrics.test.r2["f_n"]
    assert r2["agile-mlp"] < 0.2  # 0.3 s on, the band-limited input has forgotten itself
    assert min(r2[arch] for arch in r2 if arch != "agile-mlp") > 0.8, r2


@pytest.mark.whole
def test_a_lead_beyond_the_delay_asks_for_what_is_not_there_yet(
    make_echo: Callable[..., EpisodeSet], tmp_path: Path
) -> None:
    data = make_echo(steps=900, episodes=8)
    settings = settings_for("history-mlp", epochs=20)
    within, beyond = (
        trained(data, tmp_path / str(lead_s), "history-mlp", settings=settings, lead_s=lead_s)
        for lead_s in (0.25, 0.7)
    )
    assert within.metrics.test.r2["f_n"] > 0.9
    assert beyond.metrics.test.r2["f_n"] < 0.2


def test_r2_is_pooled_over_the_split_and_the_ceiling_follows_from_the_labels(
    echo: EpisodeSet, tmp_path: Path
) -> None:
    run = trained(echo, tmp_path, "history-mlp")
    noisy = tuple(
        dataclasses.replace(e, extras={"force_sd_n": np.full((len(e), 1), 0.004, np.float32)})
        for e in echo.episodes
    )
    data = dataclasses.replace(echo, episodes=noisy)
    result = score(run.predictor, data, "all", 0.0)
    truth, error = [], []
    for episode in data.episodes:
        with torch.no_grad():
            forces = run.predictor.rollout(torch.tensor(episode.observation)[None])[0].numpy()
        truth.append(episode.force[data.warm_up_steps :])
        error.append((forces - episode.force)[data.warm_up_steps :])
    truth, error = np.concatenate(truth)[:, 0], np.concatenate(error)[:, 0]
    assert result.samples == len(truth)
    assert result.rmse["f_n"] == pytest.approx(np.sqrt(np.mean(error**2)), rel=1e-4)
    assert result.r2["f_n"] == pytest.approx(1 - np.mean(error**2) / np.var(truth), rel=1e-4)
    assert result.ceiling == {"f_n": pytest.approx(1 - 0.004**2 / np.var(truth), rel=1e-4)}
    assert score(run.predictor, echo, "all", 0.0).ceiling is None


def test_the_loss_weighs_channels_in_si_and_is_1_for_the_mean() -> None:
    force = torch.randn(500, 2) * torch.tensor([0.1, 2.0])
    normal = (force - force.mean(0)) / force.std(0, unbiased=False)
    loss = WeightedMse((10.0, 1.0), force.std(0, unbiased=False))
    assert loss(torch.zeros(500, 2), normal).item() == pytest.approx(1, rel=1e-5)
    guess = torch.randn(500, 2)
    in_si = ((guess - normal) * force.std(0, unbiased=False)).square().mean(0)
    expected = (10 * in_si[0] + in_si[1]) / (torch.tensor([10.0, 1.0]) * force.var(0, False)).sum()
    assert loss(guess, normal).item() == pytest.approx(expected.item(), rel=1e-5)
    scored = torch.arange(500) < 100
    part = WeightedMse((10.0, 1.0), force.std(0, unbiased=False))(guess[:100], normal[:100])
    assert loss(guess, normal, scored).item() == pytest.approx(part.item(), rel=1e-5)


def test_the_learning_rate_rises_then_falls_to_near_zero() -> None:
    settings = FitSettings(epochs=100, learning_rate=1.0)
    rates = [learning_rate(settings, epoch) for epoch in np.linspace(0, 100, 201)]
    peak = int(np.argmax(rates))
    assert rates[peak] == pytest.approx(1.0)
    assert (np.diff(rates[: peak + 1]) > 0).all()
    assert (np.diff(rates[peak:]) < 0).all()
    assert rates[-1] == pytest.approx(0.01)


def test_a_package_in_the_place_of_runs_is_said_to_be_one(tmp_path: Path) -> None:
    path = tmp_path / "gru.onnx"
    path.write_bytes(b"x")
    with pytest.raises(UnusableInput, match=r"gru\.onnx is a package, and no folder of runs; give"):
        finished_runs(path)
