"""What a plan came to, as plan.json and as a sentence: `gap close` and `gap plan` say the same.

In: a `Plan`. Out: the input to record next, or why none is worth it.
"""

import math

from pydantic import Field

from wakedeploy.gap.search.artefacts import Artefact, Number, Part
from wakedeploy.gap.systems.planning.plan import Option, Plan
from wakedeploy.gap.wording import counted, listed, span

_MANY = 100
# Of a system that runs away without its controller, whatever limits an input has.
_CALMER = (
    "Check columns and units; narrow the limits of `Input` to what the system bears without its "
    "controller; or record it under its controller, with references that move more, and log the "
    "command that it gives."
)
# Of a system that goes away about the middle of its limits: the model may know its weight wrongly.
_HELD = (
    "It goes up and down from as near to what the logs hold on average as its limits allow. A "
    "small error of the model carries the system away from there in time: be ready to stop it, or "
    "add this to what a controller commands, and log the sum."
)
INSTEAD = "Check columns and units, widen the limits of `Input`, or add a sensor."


class Range(Part):
    """Between what an input moves, in `unit`."""

    low: Number
    high: Number
    unit: str


class Planned(Artefact):
    """plan.json: the input to record for a class, "" for none, and what was tried.

    `nats` are those of the best input in one log, `logged_nats` those of as much of the present
    logs; `logs` such logs decide it. `moved` are the inputs that it moves, `ranges` between what;
    `is_held` where they do so about what the logs hold on average. `tried` counts inputs that keep
    the outputs near what the logs have seen, `alike` are pairs that none tells apart.
    """

    rivals: list[str] = Field(alias="class")
    input: str = ""
    moved: tuple[str, ...] = ()
    ranges: dict[str, Range] = Field(default_factory=dict)
    is_held: bool = False
    seconds: Number = 0.0
    logs: int = 0
    nats: Number = 0.0
    logged_nats: Number = 0.0
    tried: int = 0
    alike: tuple[tuple[str, ...], ...] = ()
    can_command: bool = True

    @property
    def splits(self) -> bool:
        """Whether there is an input that is worth recording."""
        return bool(self.input)

    @property
    def sentence(self) -> str:
        """What to record, or why nothing."""
        if not self.can_command:
            return f"No input can be commanded, so that none can be planned. {INSTEAD}"
        if not self.tried:
            return (
                "Record none: every input that was tried takes the outputs far beyond what the "
                f"logs have seen, within few samples. {_CALMER}"
            )
        if not self.splits:
            return " ".join([self._none_worth_it, *self._same, INSTEAD])
        compared = "The present logs tell nothing of it."
        if self.logged_nats > 0.0:
            is_less = self.nats < self.logged_nats
            further = ": another log like those tells more" if is_less else ""
            compared = f"That tells {self._as_much}{further}."
        return " ".join(
            [
                f"Record {self.input} on {self._moves} for {self.seconds:.3g} s.",
                *([compared] if self.nats > 0.0 else []),
                f"To decide it with margin takes {counted(self.logs, 'such log')}.",
                *([_HELD] if self.is_held else []),
                *self._same,
            ]
        )

    @property
    def _moves(self) -> str:
        """The inputs, and between what: `thrust_n from 4.1 to 5.7 N`."""
        each = {n: f" {span(r.low, r.high, r.unit)}" for n, r in self.ranges.items()}
        return listed([f"{name}{each.get(name, '')}" for name in self.moved])

    @property
    def _as_much(self) -> str:
        """How much one log of the best input gives, compared with the present logs."""
        ratio = self.nats / self.logged_nats if self.logged_nats > 0.0 else math.inf
        times = f"over {_MANY}" if ratio > _MANY else f"{ratio:.{1 if ratio >= 1.0 else 2}f}"
        return f"{times} times as much as the present logs do in that time"

    @property
    def _none_worth_it(self) -> str:
        if not self.nats > 0.0 or self._all_alike:
            return "Record none of these: they tell nothing of it."
        if not self.logged_nats > 0.0:
            return "Record none of these: they tell next to nothing of it."
        return (
            f"Record none of these: the best tells {self._as_much}. If those do not decide it, "
            "such a log hardly will."
        )

    @property
    def _all_alike(self) -> bool:
        count = len(self.rivals)
        return bool(self.alike) and len(self.alike) == count * (count - 1) // 2

    @property
    def _same(self) -> list[str]:
        """Which members stay alike, whatever is recorded."""
        if not self.alike:
            return []
        pairs = [" and ".join(f"`{name}`" for name in pair) for pair in self.alike]
        return [f"No input that was tried tells apart {', nor '.join(pairs)}."]


def planned(made: Plan, domain: str, key: str = "") -> Planned:
    """A plan as the artefact that a folder keeps."""
    best, richest = made.best, max((option.nats for option in made.options), default=0.0)
    return Planned(
        domain=domain,
        key=key,
        rivals=list(made.names),
        input="" if best is None else best.excitation.name,
        moved=() if best is None else best.moved,
        ranges={} if best is None else _ranges(made, best),
        is_held=best is not None and best.is_held,
        seconds=0.0 if best is None else best.seconds,
        logs=0 if best is None else best.logs or 0,
        nats=richest if best is None else best.nats,
        logged_nats=made.logged_nats,
        tried=len(made.options),
        alike=made.alike,
    )


def _ranges(made: Plan, best: Option) -> dict[str, Range]:
    return {
        name: Range(
            low=float(best.columns[name].min()),
            high=float(best.columns[name].max()),
            unit=made.units[name],
        )
        for name in best.moved
        if name in best.columns
    }


def unplannable(names: list[str], domain: str, key: str = "") -> Planned:
    """The plan for a system whose inputs nobody can command."""
    return Planned(domain=domain, key=key, rivals=names, can_command=False)
