"""Real samples for the gate, and for what rounding weights changes."""

from dataclasses import dataclass

from export.samples import joined
from trainers.training.targets import shift_ahead
from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.manifest import FloatArray, Manifest


@dataclass(frozen=True)
class Real:
    """Samples of a set.

    `observation` (T, d) are in a row for the gate. `episodes` are observations
    (T, d) with the force that was to be predicted from the `warm_up`th on, (T', o), T' <= T.
    """

    observation: FloatArray
    episodes: tuple[tuple[FloatArray, FloatArray], ...]
    warm_up: int
    name: str


def real_samples(data: EpisodeSet, manifest: Manifest) -> Real:
    """The set's test episodes; for the gate others follow, and made samples if it needs more.

    Raises UnusableInput for another set than the package was trained on.
    """
    if data.sha256 != manifest.data_sha256:
        raise UnusableInput(
            "The set given with --data is not the one that this package was trained on; give that"
            " one, or none."
        )
    test = data.part("test")
    pairs = [(e.observation, shift_ahead(e.force, manifest.lead_s, data.rate_hz)) for e in test]
    warm_up = manifest.warm_up_steps
    scored = tuple(pair for pair in pairs if len(pair[1]) >= warm_up)
    joined_up = joined(test + data.part("validation") + data.part("train"), manifest)
    return Real(joined_up, scored, warm_up, f"the test episodes of the {data.domain} set")
