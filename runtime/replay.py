"""What can be proved about a package without torch: its example rollout, and its runner's manners.

In: a package. Out: a `Replay`, or CheckFailed in one sentence. `export` uses the same comparison
over far more steps.
"""

from dataclasses import dataclass

import numpy as np

from runtime.predictor import PackagePredictor
from runtime.stepped import SteppedPredictor
from wakedeploy.core.errors import CheckFailed
from wakedeploy.core.manifest import PARITY_STEPS, FloatArray, Manifest, Parity
from wakedeploy.core.package import Package

_SHORT = 64  # steps of the checks that compare the runner with itself
_DRIVEN_STEPS = 1024  # at each of the shares beyond the ranges
_HELD = 16  # steps for which an input stays
BEYOND = (0.0, 0.25)  # of a range, at both of its ends


@dataclass(frozen=True)
class Difference:
    """Worst difference between two force series; `channel` indexes the one with the largest."""

    max_abs: float
    max_rel: float
    channel: int
    step: int


_LEAST_RANGE = 0.05  # of the largest value: four roundings of it are 1e-5 of this


@dataclass(frozen=True)
class Replay:
    """How the example rollout came out, and in what share of other steps a force was limited."""

    difference: Difference
    steps: int
    limited: float


def compare(force: FloatArray, reference: FloatArray) -> Difference:
    """max|Δ| over the reference's size per output channel, (T, o) each; NaN counts as infinite."""
    apart = np.abs(np.asarray(force, np.float64) - np.asarray(reference, np.float64))  # (T, o)
    apart = np.where(np.isfinite(apart), apart, np.inf)
    relative = np.max(apart, axis=0) / size_of(reference)  # (o,)
    channel = int(np.argmax(relative))
    step = int(np.argmax(apart[:, channel]))
    return Difference(float(np.max(apart)), float(relative[channel]), channel, step)


def size_of(force: FloatArray) -> FloatArray:
    """What differences of forces (T, o) are compared with, (o,): the range of each channel.

    No more than max|force|, and no less than a twentieth of it: of a force that stays so far from
    zero, float32 keeps no finer steps. 1 where a force is zero throughout.
    """
    exact = np.asarray(force, np.float64)
    most = np.max(np.abs(exact), axis=0)
    size = np.clip(np.ptp(exact, axis=0), _LEAST_RANGE * most, most)
    return np.asarray(np.where(most > 0.0, size, 1.0))


def rolled_out(predictor: SteppedPredictor, observations: FloatArray) -> FloatArray:
    """Forces (T, o) from a cold start over observations (T, d)."""
    predictor.reset()
    return np.stack([predictor.step(observation) for observation in observations])


def replay(package: Package) -> Replay:
    """Repeat every check that needs no torch; CheckFailed names the first that fails."""
    example, manifest = package.example, package.manifest
    _require_recorded_parity(manifest.parity)
    predictor = PackagePredictor(package)
    difference = compare(rolled_out(predictor, example.observation), example.force)
    if difference.max_rel > manifest.parity.limit:
        name = manifest.force[difference.channel].name
        raise CheckFailed(
            f"The example rollout differs from its record in {name} at step {difference.step}: "
            f"relative {difference.max_rel:.1e}, limit {manifest.parity.limit:.1e}; onnxruntime "
            "computes this graph differently here: do not fly it, make it again."
        )
    require_manners(package, example.observation)
    return Replay(difference, len(example.observation), require_bounded(package))


def _require_recorded_parity(parity: Parity) -> None:
    if not parity.passed:
        raise CheckFailed(
            f"The parity recorded in the package, relative {parity.max_rel:.1e} over {parity.steps}"
            f" steps, is not within {parity.limit:.1e} over {PARITY_STEPS}; make it again with "
            "`wakedeploy export`."
        )


def require_manners(package: Package, observations: FloatArray) -> None:
    """CheckFailed unless reset forgets, two runners do not interact and batches keep apart."""
    series = observations[:_SHORT]
    alone = PackagePredictor(package)
    first, again = rolled_out(alone, series), rolled_out(alone, series)
    if not np.array_equal(first, again):
        raise CheckFailed("A reset does not bring the package back to its initial state.")
    plain, other = PackagePredictor(package), PackagePredictor(package)
    mixed = []
    for observation in series:
        mixed.append(plain.step(observation))
        other.step(-observation)
    if not np.array_equal(first, np.stack(mixed)):
        raise CheckFailed("Two runners of the package change each other's forces.")
    both = PackagePredictor(package, batch=2)
    pairs = np.stack([both.step(np.stack([-o, o]))[1] for o in series])
    if compare(pairs, first).max_rel > package.manifest.parity.limit:
        raise CheckFailed("In a batch, one series of the package changes another's forces.")


def require_bounded(package: Package) -> float:
    """The share of steps in which a force was at a limit; CheckFailed if one was beyond, or none.

    The model is driven for 2,048 steps, without a reset, with inputs over their observed ranges and
    a quarter of them beyond: corners of the ranges and points within, each held for 16 steps.
    """
    manifest = package.manifest
    inputs = np.concatenate([_over(manifest, share) for share in BEYOND])  # (T, d)
    forces = rolled_out(PackagePredictor(package), inputs)  # (T, o)
    low, high = (np.array([getattr(c, end) for c in manifest.force]) for end in ("low", "high"))
    possible = (forces >= low) & (forces <= high)  # (T, o); false where a force is no number
    if not possible.all():
        step, column = np.argwhere(~possible)[0]
        channel = manifest.force[column]
        raise CheckFailed(
            f"Driven over its observed ranges and {BEYOND[-1]:.0%} beyond, the model gives a"
            f" {channel.name} of {forces[step, column]:g} {channel.unit} at step {step}, where"
            f" {channel.low:g} to {channel.high:g} is possible: do not fly it."
        )
    return float(np.mean(((forces == low) | (forces == high)).any(axis=1)))


def _over(manifest: Manifest, share: float) -> FloatArray:
    """Inputs (_DRIVEN_STEPS, d) over the observed ranges, widened at both ends by a share."""
    low, high = (
        np.array([getattr(c, end) for c in manifest.observation]) for end in ("min", "max")
    )
    draw = np.random.default_rng(0)
    places = draw.random((_DRIVEN_STEPS // _HELD, len(low)))  # (N, d)
    places[::2] = np.round(places[::2])  # every other one a corner
    middle, half = 0.5 * (low + high), (0.5 + share) * (high - low)  # (d,)
    inputs: FloatArray = (middle + (2.0 * places - 1.0) * half).astype(np.float32)
    return np.repeat(inputs, _HELD, axis=0)
