"""A ninth architecture, a new effect and a new domain, each one file of another package.

The package lies outside the tree and is found by its entry points alone.
"""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

import wakedeploy as wd
from runtime.loop.pilot import FORCE, OBSERVATION
from trainers.build import ARCHITECTURES
from wakedeploy.cli import main
from wakedeploy.core.discovery import ARCHITECTURE, DOMAIN, offers
from wakedeploy.core.names import architectures, domains
from wakedeploy.domains.gantry import record
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.ranking import rank
from wakedeploy.gap.systems.gantry.flight import flight_from_log
from wakedeploy.gap.systems.gantry.likelihood import GantryModel
from wakedeploy.gap.systems.gantry.search.naming import name_effects
from wakedeploy.gap.systems.gantry.search.outcome import Thresholds
from wakedeploy.physics import effects
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.sweep.generate import Generate
from wakedeploy.sweep.generate import make as make_for_sweep

NINTH = '''
"""Leaky mean: the mean of the past, which forgets, beside the present."""

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import nn

from trainers.architecture import Architecture
from trainers.bounds import Bound
from trainers.dimensions import SEQUENCE_FIT, Span
from trainers.memory import Memory
from trainers.model import StateModel


@dataclass(frozen=True)
class Hyper:
    hidden: int = 16
    leak: float = 0.1

    dimensions: ClassVar = (Span("hidden", 4, 64, log=True), *SEQUENCE_FIT)
    bounds: ClassVar = {"leak": Bound(0.01, 1)}


class LeakyMean(StateModel):
    def __init__(self, sizes, hyper):
        super().__init__()
        self.leak = hyper.leak
        self.memory = Memory("state", states={"mean": (sizes.inputs,)})
        self.net = nn.Sequential(
            nn.Linear(2 * sizes.inputs, hyper.hidden), nn.Tanh(),
            nn.Linear(hyper.hidden, sizes.outputs),
        )

    def forward(self, sequence, state=None):
        state = self.initial_state(len(sequence)) if state is None else state
        forces = []
        for observation in sequence.unbind(1):
            force, state = self.step(observation, state)
            forces.append(force)
        return torch.stack(forces, 1), state

    def step(self, observation, state):
        mean = state["mean"] + self.leak * (observation - state["mean"])
        return self.net(torch.cat([observation, mean], 1)), {"mean": mean}


ARCHITECTURE = Architecture(LeakyMean, Hyper, colour="#123456", marker="*")
'''

EFFECT = '''
"""A force that goes with the carriage's speed."""

from wakedeploy.physics.effects import Effect, Parameter


class CarriageLift(Effect):
    name = "carriage-lift"
    physics = "The carriage's motion lifts the sufferer."
    equation = "F = gain_nspm · vx"
    stage = "force"
    parameters = (Parameter("gain_nspm", "N s/m", scale=0.3, low=-3.0, high=3.0),)

    def force_n(self, p, m, s):
        return p["gain_nspm"] * m.vx_mps


EFFECTS = (CarriageLift(),)
'''

DOMAIN_FILE = '''
"""A tank in which one wave follows another."""

import numpy as np

from wakedeploy.core.episodes import Channel, Episode, EpisodeSet
from wakedeploy.domains.domain import Setting, Simulated


def make_set(*, minutes, seed, height=1.0, progress=None):
    draw, steps = np.random.default_rng(seed), round(60 * minutes * 10 / 6)
    parts = []
    for i in range(6):
        level = np.convolve(draw.normal(size=steps + 8), np.ones(5) / 5, "valid")
        seen, force = level[4:, None], height * level[:-4, None]
        parts.append(Episode(f"e{i}", seen.astype("f4"), force.astype("f4")))
        if progress is not None:
            progress(i + 1, 6)
    names = ["test", "validation", "train", "train", "train", "train"]
    return EpisodeSet(
        domain="tank", rate_hz=10.0, window_s=1.0, loss_weights=(1.0,),
        observation=(Channel("level_m", "m"),), force=(Channel("push_n", "N"),),
        split={e.name: s for e, s in zip(parts, names, strict=True)}, episodes=tuple(parts),
        provenance={"generator": "tank", "minutes": minutes},
    )


DOMAIN = Simulated(
    main="push_n", help_text="Let waves run through a tank.", examples=("--out sets/tank",),
    make=make_set, minutes=5.0,
    settings=(Setting("height", "number", "Of the waves.", default=1.0, low=0.1, high=9.0),),
)
'''

GAP_DOMAIN_FILE = '''
"""A pail whose level follows a pump; what the baseline lacks is a leak."""

import numpy as np

from wakedeploy.gap.evidence.fits import Free
from wakedeploy.gap.search.comparison import Record
from wakedeploy.gap.systems.domains.domain import GapDomain
from wakedeploy.gap.systems.likelihood.response import ResponseModel


class PailModel(ResponseModel):
    name = "pail"
    channels = (("level_m", "m"),)
    noise_start = ((0.01, 0.1, 0.01),)
    noise_is_white = True
    effects = {
        "leak": (Free("leak.rate", "m/s", 0.0, 0.05, -1.0, 1.0, 0.01, (0.02, -0.02)),),
        "surge": (Free("surge.size", "m", 0.0, 0.05, -1.0, 1.0, 0.01, (0.02, -0.02)),),
    }

    def __init__(self):
        draw = np.random.default_rng(5)
        self.time_s = np.arange(60) / 20.0
        self.pump = draw.normal(size=(8, 60)).cumsum(1) / 20.0
        self.surge = np.sin(draw.uniform(2.0, 5.0, (8, 1)) * self.time_s)
        self.records = [
            Record(f"day {i}", self.time_s, self.response({"leak.rate": 0.04}, i)
                   + 0.01 * draw.normal(size=(1, 60)))
            for i in range(8)
        ]

    def response(self, values, episode):
        level = self.pump[episode] - values.get("leak.rate", 0.0) * self.time_s
        return (level + values.get("surge.size", 0.0) * self.surge[episode])[None]


GAP_DOMAIN = GapDomain(lambda path: PailModel(), lambda model, progress: {}, is_simulated=True)
'''

ENTRY_POINTS = """
[wakedeploy.architectures]
leaky-mean = wake_extras.ninth:ARCHITECTURE
[wakedeploy.effects]
wake-extras = wake_extras.effect:EFFECTS
[wakedeploy.domains]
tank = wake_extras.tank:DOMAIN
[wakedeploy.gap_domains]
pail = wake_extras.pail:GAP_DOMAIN
"""


def forget() -> None:
    """As in a new process: what there is is looked for again."""
    offers.cache_clear()
    effects.found_effects.cache_clear()


def install(site: Path, name: str, entry_points: str) -> None:
    """A package's metadata, as an installer leaves it."""
    info = site / f"{name.replace('-', '_')}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(entry_points)


@pytest.fixture(scope="module", autouse=True)
def extras(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    site = tmp_path_factory.mktemp("site")
    package = site / "wake_extras"
    package.mkdir()
    for name, text in {
        "__init__": "",
        "ninth": NINTH,
        "effect": EFFECT,
        "tank": DOMAIN_FILE,
        "pail": GAP_DOMAIN_FILE,
    }.items():
        (package / f"{name}.py").write_text(text.lstrip())
    install(site, "wake-extras", ENTRY_POINTS)
    with pytest.MonkeyPatch.context() as patched:
        patched.syspath_prepend(str(site))
        forget()
        yield
    forget()
    for name in [name for name in sys.modules if name.startswith("wake_extras")]:
        del sys.modules[name]


def wakedeploy(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words], prog_name="wakedeploy")


def gantry_set() -> wd.EpisodeSet:
    """A set with the gantry's channels, made of noise."""
    draw = np.random.default_rng(0)
    parts = []
    for i in range(6):
        seen = draw.normal(size=(3300 if i == 0 else 200, len(OBSERVATION))).astype("f4")
        force = 0.01 * seen[:, :1] - 0.1
        parts.append(wd.Episode(f"e{i}", seen, force))
    splits = ["test", "validation", "train", "train", "train", "train"]
    return wd.EpisodeSet(
        domain="gantry", rate_hz=32.0, window_s=0.5, loss_weights=(1.0,),
        observation=tuple(wd.Channel(*c) for c in OBSERVATION),
        force=tuple(wd.Channel(*c) for c in FORCE),
        split={e.name: s for e, s in zip(parts, splits, strict=True)}, episodes=tuple(parts),
        provenance={"default_lead_s": default_lead_s(wd.default_rig())},
    )  # fmt: skip


@pytest.mark.whole
def test_a_ninth_architecture_is_trained_exported_checked_and_flown(tmp_path: Path) -> None:
    assert architectures()[-1] == "leaky-mean"
    assert "leaky-mean" in " ".join(wakedeploy("train", "--help").output.split())
    assert not ARCHITECTURES["leaky-mean"].solved
    gantry_set().write(tmp_path / "set")
    run = tmp_path / "runs" / "gantry" / "leaky-mean" / "s0"
    for words in (
        ["train", "--data", tmp_path / "set", "--arch", "leaky_mean", "--epochs", 1,
         "--hyper", "leaky-mean.leak=0.2", "--out", tmp_path / "runs", "--no-pictures"],
        ["export", "--arch", "leaky-mean", "--run", run, "--data", tmp_path / "set",
         "--out", tmp_path / "ninth.onnx"],
        ["check", tmp_path / "ninth.onnx"],
    ):  # fmt: skip
        done = wakedeploy(*words)
        assert done.exit_code == 0, done.output
    assert wd.fly(tmp_path / "ninth.onnx", seconds=3).ended == "whole"
    refused = wakedeploy("train", "--data", tmp_path / "set", "--arch", "leaky-mean",
                         "--hyper", "leaky-mean.leak=7", "--out", tmp_path / "x")  # fmt: skip
    assert "leaky-mean: leak = 7 has to be a number from 0.01 to 1" in refused.output


@pytest.fixture(scope="module")
def lifted() -> GantryModel:
    """Flights in which the new effect is hidden, as the rig without it explains them."""
    rig = wd.default_rig()
    truth = wd.with_effect(rig, "carriage-lift", gain_nspm=0.6)
    logs = [record(truth, seconds=10, seed=s, model_rig=rig).without_truth() for s in (51, 52, 53)]
    return GantryModel(rig, [flight_from_log(log, rig, "flight") for log in logs])


def test_a_new_effect_is_hidden_and_found(lifted: GantryModel) -> None:
    """It stands in a rig file, acts in the plant and the likelihood, and is ranked."""
    base = fit(lifted, (), (0, 1, 2))
    first, other = rank(lifted, base, ("coulomb-friction", "carriage-lift"))
    assert (first.name, other.name) == ("carriage-lift", "coulomb-friction")
    assert first.gain_nats > 10.0 + other.gain_nats
    low, high = first.fit.interval("carriage-lift.gain_nspm", 0.99)
    assert low < 0.6 < high


@pytest.mark.slow
def test_a_new_effect_is_named(lifted: GantryModel) -> None:
    limits = Thresholds(6.0, 8.0, 8.0, 36.0, 0.02, 0.02, 0.003)
    tried = ("coulomb-friction", "carriage-lift", "range-delay")
    answer = name_effects(wd.default_rig(), lifted, limits, candidates=tried)
    assert answer.effects == ("carriage-lift",)


def test_a_new_domain_is_made_swept_and_trained_on(tmp_path: Path) -> None:
    assert domains()[-1] == "tank"
    told = wakedeploy("data", "make", "--help").output
    assert "A tank in which one wave follows another." in " ".join(told.split())
    assert "Let waves run" in wakedeploy("data", "make", "tank", "--help").output
    made = wakedeploy("data", "make", "tank", "--out", tmp_path / "set", "--height", 2)
    assert made.exit_code == 0, made.output
    refused = wakedeploy("data", "make", "tank", "--out", tmp_path / "x", "--height", 99)
    assert refused.exit_code == 2
    swept = make_for_sweep(Generate("a", "tank", 5.0, 0, {"height": 2.0}))
    assert swept.sha256 == wd.make_set("Tank", minutes=5.0, height=2.0).sha256
    done = wakedeploy("train", "--data", tmp_path / "set", "--arch", "agile-mlp", "--epochs", 1,
                      "--out", tmp_path / "runs", "--no-pictures")  # fmt: skip
    assert done.exit_code == 0, done.output


def test_what_a_new_domain_lacks_is_named(tmp_path: Path) -> None:
    done = wakedeploy("gap", "domain", "pail", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    assert "pail: named: leak" in done.output
    answer = json.loads((tmp_path / "domain.json").read_text())
    size = answer["parameters"]["leak.rate"]
    assert size["low"] < 0.04 < size["high"]
    refused = wakedeploy("gap", "domain", "pale", "--out", tmp_path)
    assert "did you mean pail?" in refused.output


@pytest.mark.parametrize(
    ("entry_points", "told"),
    [
        ("[wakedeploy.architectures]\ngru = there:X\n", "wakedeploy and other both offer"),
        ("[wakedeploy.architectures]\nbroken = absent:X\n", "cannot be used"),
        ("[wakedeploy.architectures]\nbroken = json:dumps\n", "it is no Architecture"),
    ],
)
def test_what_cannot_be_used_is_told_with_its_package(
    entry_points: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install(tmp_path, "other", entry_points)
    with monkeypatch.context() as patched:
        patched.syspath_prepend(str(tmp_path))
        forget()
        with pytest.raises(wd.UnusableInput, match=f"other.*{told}|{told}"):
            ARCHITECTURES["broken"]
    forget()


def test_names_are_told_without_loading_what_they_name() -> None:
    assert offers(ARCHITECTURE)["leaky-mean"].by == "wake-extras"
    assert offers(DOMAIN)["tank"].title == "A tank in which one wave follows another"
