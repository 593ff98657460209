"""What a step of a predictor costs once it is exported: its own package, the shipped runner."""

import time

import numpy as np

from export.example import band_limited, example_rollout, rollout
from export.graph import graph_bytes
from export.limits import force_channels
from export.packaging import manifest_of
from runtime.predictor import PackagePredictor
from trainers.model import Predictor
from trainers.training.runs import RunConfig
from wakedeploy.core.manifest import FloatArray
from wakedeploy.core.package import Package, make_package

_ROUNDS, _STEPS, _WARM_UP = 5, 400, 64


def step_p99_us(predictor: Predictor, config: RunConfig, observations: FloatArray) -> float:
    """The 99th percentile of a step's time, in µs, on one thread, over observations (T, d).

    Of five rounds of 400 steps the quietest counts: what else runs on the machine makes a round
    slower, never faster. The package stays in memory and has not passed the parity gate.
    """
    runner = PackagePredictor(unproved_package(predictor, config))
    series = np.resize(observations, (_STEPS, observations.shape[1]))
    _timed_us(runner, series[:_WARM_UP])
    return min(float(np.percentile(_timed_us(runner, series), 99)) for _ in range(_ROUNDS))


def unproved_package(predictor: Predictor, config: RunConfig) -> Package:
    """A package to be timed and thrown away: it has not passed the parity gate.

    The forces that it says were seen are those of its own example rollout.
    """
    observation = band_limited(config.observation, config.rate_hz, config.seed)
    force = force_channels(config.force, [rollout(predictor, observation)])
    manifest = manifest_of(predictor, config, force, None)
    example = example_rollout(predictor, config, force)
    return make_package(graph_bytes(predictor, force), manifest, example)


def _timed_us(runner: PackagePredictor, series: FloatArray) -> list[float]:
    took = []
    for observation in series:
        began = time.perf_counter_ns()
        runner.step(observation)
        took.append((time.perf_counter_ns() - began) / 1e3)
    return took
