"""What a study is: everything that has to be the same for two trials to be compared."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path

from trainers.dimensions import Dimension
from trainers.training.fit import FitSettings
from trainers.training.runs import TRAINING, RunConfig
from trainers.training.trainer import configure, require_enough, settings_for, tapes
from trainers.tuning.space import Point, in_effect, search_space, split
from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import UnusableInput

# What a step may cost, and what it is called where numbers of it stand.
COSTS = {
    "latency": "p99 of a step [µs]",
    "flash": "flash of its C [bytes]",
    "ram": "RAM of its C [bytes]",
    "instructions": "instructions of its C, on a Cortex-M4F",
}
OBJECTIVES = (("rmse",), *(("rmse", cost) for cost in COSTS))
FEWEST_SAMPLES = (
    64  # scored samples of validation, below which trials would be told apart by chance
)


@dataclass(frozen=True)
class Plan:
    """One study: the set (by its hash), the architecture, what is searched and how it is judged.

    Units: `window_s` and `rate_hz` (the set's) and `lead_s` in seconds and hertz. Trials have fewer
    than `budget` trainable weights.
    """

    arch: str
    domain: str
    data_sha256: str
    window_s: float
    rate_hz: float
    lead_s: float
    epochs: int
    budget: int
    objective: tuple[str, ...]
    seed: int
    dimensions: tuple[Dimension, ...]
    training: int = TRAINING  # another revision's trials are no rivals of these

    @property
    def identity(self) -> dict[str, object]:
        """What the study is known by, in JSON's types and in words that an error may use."""
        fields = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        row = {"dimensions": " ".join(map(str, self.dimensions))}
        return fields | row | {"objective": ",".join(self.objective)}

    @property
    def cost(self) -> str | None:
        """The cost of a step by which a trial is judged, too; None for the error alone."""
        return self.objective[1] if len(self.objective) > 1 else None

    def settings(self, changed: dict[str, float] | None = None) -> FitSettings:
        """How a trial is fitted, with some settings changed."""
        return settings_for(self.arch, epochs=self.epochs, others=changed)

    def configured(self, data: EpisodeSet, point: Point) -> RunConfig:
        """The run of a point. Raises UnusableInput for what cannot be built."""
        hyper, changed = split(self.arch, in_effect(self.arch, point, self.rate_hz))
        return configure(
            data,
            self.arch,
            seed=self.seed,
            lead_s=self.lead_s,
            hyper=hyper,
            settings=self.settings(changed),
        )


def make_plan(
    data: EpisodeSet,
    arch: str,
    *,
    lead_s: float,
    epochs: int,
    budget: int,
    objective: tuple[str, ...],
    seed: int,
    asked: tuple[str, ...] = (),
) -> Plan:
    """A plan for this set; UnusableInput for what cannot be searched or judged on it."""
    if objective not in OBJECTIVES:
        known = " or ".join(",".join(names) for names in OBJECTIVES)
        raise UnusableInput(f"--objective {','.join(objective)}: choose {known}.")
    dimensions = search_space(arch, data.window_s, data.rate_hz, asked)
    _check_large_enough(data, lead_s)
    return Plan(
        arch=arch,
        domain=data.domain,
        data_sha256=data.sha256,
        window_s=data.window_s,
        rate_hz=data.rate_hz,
        lead_s=lead_s,
        epochs=epochs,
        budget=budget,
        objective=objective,
        seed=seed,
        dimensions=dimensions,
    )


def _check_large_enough(data: EpisodeSet, lead_s: float) -> None:
    """Told now, not when the study ends: each split has to have something to say."""
    require_enough(data, lead_s)
    _, held_out = tapes(data, lead_s)
    samples = int(held_out.scored.sum())
    if samples < FEWEST_SAMPLES:
        raise UnusableInput(
            f"The validation split of this {data.domain} set has {samples} samples after warm-up"
            f" and lead, and telling trials apart takes {FEWEST_SAMPLES}; make a longer set."
        )
    if not bool((held_out.force[held_out.scored].std(0) > 0).any()):
        raise UnusableInput(
            f"The force never changes in the validation split of this {data.domain} set, so that it"
            " cannot tell trials apart; make a longer set."
        )


def described(plan: Plan, data_folder: Path) -> dict[str, object]:
    """What the files of a study say about where it comes from; no path of this machine."""
    return {
        "arch": plan.arch,
        "domain": plan.domain,
        "data": data_folder.resolve().name,
        "data_sha256": plan.data_sha256,
        "lead_s": plan.lead_s,
        "budget": plan.budget,
        "objective": ",".join(plan.objective),
        "epochs": plan.epochs,
        "seed": plan.seed,
        "dimensions": [str(dimension) for dimension in plan.dimensions],
    }
