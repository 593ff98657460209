"""Flies one reference twice: the wake source idle, and the wake source as planned.

In: a `RunRequest` and a folder. Out: two run logs for each pair, tied by their metadata (`pair_id`,
`wake`: off or on, `pair_order`: which was flown first). What differs between them is the wake.
"""

import uuid
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from runtime.request import RunRequest, Show, Tell, Warn
from runtime.run import fly
from wakedeploy.core.errors import CheckFailed, UnusableInput

_SEEDS_OF_A_FLIGHT = 1_000_003  # apart from each other, and from the seeds that people choose

Ask = Callable[[str], bool]
TellLeg = Callable[["Leg"], Tell]


@dataclass(frozen=True)
class Leg:
    """One flight of a pair: where it is recorded, and whether its wake source runs."""

    pair: int
    wake: str  # "off" or "on"
    log: Path
    order: int  # 1: the pair's first flight


@dataclass(frozen=True)
class Pair:
    """The two recordings of a pair, and which of them was flown first."""

    pair_id: str
    off: Path
    on: Path
    first: str


def legs(folder: Path, pairs: int) -> list[Leg]:
    """All flights in order: off, on; on, off; … so that a battery that drains is no wake."""
    found = []
    for pair in range(1, pairs + 1):
        number = f"-{pair:02d}" if pairs > 1 else ""
        for order, wake in enumerate(("off", "on") if pair % 2 else ("on", "off"), 1):
            found.append(Leg(pair, wake, folder / f"wake-{wake}{number}.mcap", order))
    return found


def fly_pairs(
    request: RunRequest,
    folder: Path,
    pairs: int = 1,
    *,
    ask: Ask | None = None,
    tell: TellLeg | None = None,
    show: Show | None = None,
    warn: Warn | None = None,
) -> list[Pair]:
    """Fly `pairs` pairs; each flight is a whole run of `runtime.run.fly`, and raises what it does.

    `ask` is given a sentence before every flight but the first, and stops the series by False:
    CheckFailed then. What ends one flight ends the series, its log and those before it are whole.
    Raises UnusableInput when a recording of that name exists already.
    """
    flights, series = legs(folder, pairs), uuid.uuid4().hex[:12]
    _require_room(folder, flights)
    for index, leg in enumerate(flights):
        if index and ask is not None and not ask(_question(leg)):
            raise CheckFailed(
                f"The flight with the wake {leg.wake} was not flown; {flights[index - 1].log} and "
                "the recordings before it are whole."
            )
        fly(
            _request(request, leg, f"{series}-{leg.pair}", index),
            tell(leg) if tell is not None else None,
            show,
            warn,
        )
    return [
        _pair(flights[i : i + 2], f"{series}-{flights[i].pair}") for i in range(0, 2 * pairs, 2)
    ]


def _request(request: RunRequest, leg: Leg, pair_id: str, index: int) -> RunRequest:
    """The same reference for every flight; a virtual gantry's noise is another each time."""
    notes = {"pair_id": pair_id, "wake": leg.wake, "pair_order": str(leg.order)}
    plant_seed = request.seed + index * _SEEDS_OF_A_FLIGHT
    if request.port is None:
        notes["plant_seed"] = str(plant_seed)
    return replace(
        request,
        log=leg.log,
        wake_off=leg.wake == "off",
        plant_seed=plant_seed,
        notes={**request.notes, **notes},
    )


def _require_room(folder: Path, flights: list[Leg]) -> None:
    """UnusableInput before the first flight rather than after it."""
    taken = [leg.log for leg in flights if leg.log.is_file() and leg.log.stat().st_size > 0]
    if taken:
        raise UnusableInput(f"{taken[0]}: there is already a recording; name another --out folder.")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UnusableInput(
            f"{folder}: no folder can be made there ({error.strerror}); name another --out folder."
        ) from error


def _question(leg: Leg) -> str:
    state = "running" if leg.wake == "on" else "idle"
    return f"Next: the same reference with the wake source {state}. Is the rig clear?"


def _pair(flown: list[Leg], pair_id: str) -> Pair:
    by_wake = {leg.wake: leg.log for leg in flown}
    return Pair(pair_id, by_wake["off"], by_wake["on"], flown[0].wake)
