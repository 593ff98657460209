"""Before any fit: what of a system moves its outputs on these logs, how far, and what looks alike.

In: a `LogModel`. Out: rows of plain numbers. A constant is moved by its spread (a tenth where it
has none), an effect to its first start; how far is in standard deviations of the prediction errors,
all samples together, and what is left of that where everything else may follow.
"""

import itertools
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.recording import Recording
from wakedeploy.core.units import contradicted, same_dimension
from wakedeploy.gap.evidence.fits import Fit, FloatArray, prior_precision
from wakedeploy.gap.evidence.inference import fit
from wakedeploy.gap.evidence.separation import whitened
from wakedeploy.gap.progress import StepsDone, uncounted
from wakedeploy.gap.rules import FEWEST_IN_ALL
from wakedeploy.gap.search.first_look import changes
from wakedeploy.gap.systems.calls import attempted
from wakedeploy.gap.systems.coupled_forces import bent_inputs, coupled_forces
from wakedeploy.gap.systems.duration import long_search
from wakedeploy.gap.systems.late_readings import late_readings
from wakedeploy.gap.systems.likelihood.blocks import SHORTEST, Log, held
from wakedeploy.gap.systems.likelihood.logs import LogModel
from wakedeploy.gap.systems.misread import misread
from wakedeploy.gap.systems.runaway import runaways
from wakedeploy.gap.systems.statements import MOST_STEPS
from wakedeploy.gap.systems.system import Input, StateSpace
from wakedeploy.gap.systems.wrapped_angles import own_wraps
from wakedeploy.gap.wording import behind, counted, listed, minus

LIKE = 0.95  # correlation of what two leave, from which logs hardly tell them apart
_AHEAD, _FINER, _PLACES = 10, 4, 1000  # samples on, steps for one, places that are tried
_AT_REST_NATS = 1e-3  # a fit's last step promises less
_OUTSIDE = 0.5  # of the width of its limits: so far beyond them an input has another unit
_MOVING = 0.05  # of its usual rate, from which a state is not at rest
_MANY_TURNS = 3.0  # that an output's range may have before degrees are thought of
_FEWEST_STUCK = 3  # samples at a column's end
_FEWEST_VISITS = 3  # to an end; fewer are a rest, or a plateau
_HUNG, _EQUAL = 20, 0.01  # equal readings in a row; share of shorter runs in other places
_JAGGED = 0.3  # share of bends to the other side; white noise has two thirds
_FEW_VALUES = 20  # of a column whose ends say nothing, as of steps that go up and down
_FEWEST_RUNS, _USUAL_RUN, _FROZEN = 20, 0.9, 20.0  # of equal samples; a quantile, and times that
_STUCK = 0.01  # share of samples at a column's end, from which it is called saturated
_SAME_END = 0.01  # of a column's span: how near its end is to that of `measure`
_GROUND_EFFECT = "ground-effect"
_HEIGHT = re.compile("(z|h|height|altitude|alt)(_|$)", re.IGNORECASE)
_CUT = 0.1  # the same share, from which what lies beyond may be what an effect is named for


@dataclass(frozen=True)
class Row:
    """A constant or effect: what `moved`, what is `remaining` [sd], and what looks `like` it."""

    name: str
    moved: float
    remaining: float
    like: tuple[str, ...]


def checked_base(model: LogModel) -> Fit:
    """Noise and constants fitted, to the end: the table's third digit is to be no accident."""
    begun = fit(model, (), range(model.episodes))
    return fit(model, (), begun.episodes, begun.theta, enough_nats=_AT_REST_NATS)


def rows(model: LogModel, base: Fit, steps: StepsDone = uncounted) -> list[Row]:
    """Constants first, then effects, in the library's order."""
    known = np.concatenate(whitened(base.slopes))
    prior = np.sqrt(prior_precision(base.free))
    moved: dict[str, FloatArray] = {}
    remaining: dict[str, FloatArray] = {}
    for i, free in enumerate(base.free):
        if free.name.startswith("constant."):
            size = free.prior_sd if np.isfinite(free.prior_sd) else 0.1 * abs(free.neutral)
            moved[free.name] = known[:, i] * size
            others = [j for j in range(len(base.free)) if j != i]
            remaining[free.name] = _residual(moved[free.name], known[:, others], prior[others])
    for name, change in changes(model, base, list(model.library), steps).items():
        moved[name] = change
        remaining[name] = _residual(change, known, prior)
    names = list(moved)
    alike = _alike(names, remaining)
    return [
        Row(n, float(np.linalg.norm(moved[n])), float(np.linalg.norm(remaining[n])), alike[n])
        for n in names
    ]


def column_notes(model: LogModel) -> list[str]:
    """What the columns themselves show: ends at which they stay, what never changes or hung."""
    notes = [why] if (why := model.without_effects) else []
    logs = model.logs
    if model.episodes < FEWEST_IN_ALL:
        notes.append(
            f"too short for a search: these logs make {counted(model.episodes, 'block')} of at "
            f"least {SHORTEST} samples, and {FEWEST_IN_ALL} are needed; record more. They "
            f"last {_duration(logs, model.dt_s)}; if it was longer, the time's unit is wrong."
        )
    part = model.thinned()
    if part is not model:
        searched = max(b.stop - b.start for b in part.blocks)
        notes.append(
            f"long logs: a search looks at the first {searched} samples of each block; sizes, and "
            "what sealed blocks say, come from all."
        )
    notes += [*runaways(model), *long_search(model)]
    notes += _ranges(model)
    notes += misread(model)
    notes += [*_names(model), *_limits(model), *_constants(model), *_beginnings(model)]
    notes += [*own_wraps(model), *_curves(model), *_heights(model.system)]
    for i, stated in enumerate(model.system.inputs):
        if stated.law is not None:  # it is as what it is made of
            continue
        values = np.concatenate([log.inputs[i] for log in logs])
        notes += _notes(f"input {stated.name}", values)
        notes += _silences(stated, model.recordings)
        if any(p.role == "input" and p.name == stated.name for p in model.system.ports):
            notes += _off_zero(stated, values)
        limits = (values.min(), values.max())
        frozen = [_frozen(stated, log.name, log.inputs[i], limits, model.dt_s) for log in logs]
        notes += _once([note for each in frozen for note in each])
    cut = cut_outputs(model)
    for i, shown in enumerate(model.system.outputs):
        values = np.concatenate([log.outputs[i] for log in logs])
        ends = _notes(f"output {shown.name}", values)
        notes += [next((note for note in cut if note.startswith(end)), end) for end in ends]
        if model.strays[shown.name]:
            notes.append(
                f"output {shown.name}: {counted(model.strays[shown.name], 'reading')} that stood "
                "alone, far from the others, left out, as `outlier_share` allows."
            )
        missing = float(np.mean(~np.isfinite(values)))
        if missing > 0.0:
            share = "under 0.1%" if missing < 0.0005 else f"{missing:.1%}"
            notes.append(f"output {shown.name}: {share} of the samples are not measured.")
    return [
        *notes,
        *late_readings(model),
        *hung_outputs(model),
        *coupled_forces(model),
        *bent_inputs(model),
        *own_notes(model),
    ]


def _once(notes: list[str]) -> list[str]:
    """What is said of the first of several logs, and of how many more."""
    if len(notes) < 2:
        return notes
    return [f"{notes[0]} The same holds of {counted(len(notes) - 1, 'more log')}."]


def _silences(stated: Input, recordings: Sequence[Recording]) -> list[str]:
    """That an input lacks numbers: nobody knows what drove the system meanwhile."""
    count, longest_s = held(recordings, stated.name)
    said = (
        f"input {stated.name}: {counted(count, 'sample')} without a number, up to {longest_s:.3g} s"
        " at once; the last one is held there. Cut the log where it was another."
    )
    return [said] if count else []


def own_notes(model: LogModel) -> list[str]:
    """What a system itself says of its logs: its `log_notes`, as for a contact of bodies."""
    names = [output.name for output in model.system.outputs]
    columns = np.concatenate([log.outputs for log in model.logs], axis=1)
    where = f"{model.system.name}.log_notes"
    outputs = dict(zip(names, columns, strict=True))
    notes = attempted(where, model.system.log_notes, outputs)
    if not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
        raise UnusableInput(f"{where}: returned {notes!r:.60}; return a list of sentences.")
    return notes


def cut_outputs(model: LogModel) -> list[str]:
    """Outputs that come to one of their ends again and again, and stay, as if a sensor ended there.

    A search takes the sensor as `measure` states it; where that ends there as well, all is said.
    """
    afar = model.system.shown_afar()
    columns = np.concatenate([log.outputs for log in model.logs], axis=1)
    notes = []
    for shown, row in zip(model.system.outputs, columns, strict=True):
        values = row[np.isfinite(row)]
        for word, end, share in _at_ends(values, _CUT):
            is_rest = end == 0.0 or _visits(values, end) < _FEWEST_VISITS
            if not (is_rest or _is_stated(word, end, np.ptp(values), afar.get(shown.name))):
                notes.append(
                    f"output {shown.name} {_staying(word, end, share)}. If its sensor ends there, "
                    "and not the motion, `measure` has to say so, as by np.clip; what the sensor "
                    "hides may else be taken for an effect."
                )
    return notes


def _is_stated(word: str, end: float, span: float, afar: FloatArray | None) -> bool:
    """Whether no state is shown beyond an end of a column whose values have this span."""
    beyond = np.empty(0) if afar is None else afar[np.isfinite(afar)]
    if not beyond.size:
        return False
    farthest = float(beyond.max()) - end if word == "most" else end - float(beyond.min())
    return farthest < _SAME_END * span


def _visits(values: FloatArray, value: float) -> int:
    """How often a column comes to a value."""
    there = values == value
    return int(np.sum(there[1:] & ~there[:-1])) + int(there[0])


def hung_outputs(model: LogModel) -> list[str]:
    """Outputs whose sensor hung: noise never lets two readings be equal, but there all are.

    At 0 a speed may be at rest, and what begins or ends a log may be before or behind the motion.
    """
    notes = []
    for i, shown in enumerate(model.system.outputs):
        for log in model.logs:
            known = np.flatnonzero(np.isfinite(log.outputs[i]))
            values = log.outputs[i][known]
            begins = np.flatnonzero(np.diff(values)) + 1  # but that of the first run
            lasts = np.diff(begins)  # and all but the last one
            hung = [
                k for k in np.flatnonzero(lasts >= _HUNG)
                if values[begins[k]] != 0.0 and _visits(values, values[begins[k]]) == 1
            ]  # fmt: skip
            usual = lasts[lasts < _HUNG]
            is_alone = np.sum(usual == 1) > max((1.0 - _EQUAL) * len(usual), 0.5 * len(lasts))
            if not hung or not is_alone or not _is_noisy(values):
                continue
            first, count = hung[int(np.argmax(lasts[hung]))], len(hung)
            more = f" (and {counted(count - 1, 'other time')})" if count > 1 else ""
            notes.append(
                f"output {shown.name} is exactly {minus(f'{values[begins[first]]:.9g}')}"
                f"{behind(shown.unit)} in {log.name} for {model.dt_s * lasts[first]:.3g} s, from "
                f"{model.dt_s * known[begins[first]]:.4g} s after its start{more}, and changes "
                "with each sample elsewhere, as if its sensor hung. To leave that out, write "
                'absent = [the number that the log has there] and missing = "nan" into its column '
                "in columns.toml."
            )
    return notes


def _is_noisy(values: FloatArray) -> bool:
    """Whether a column's slope goes up and down from sample to sample, as no motion does."""
    bends = np.diff(values[np.isfinite(values)], 2)
    bends = bends[bends != 0.0]
    return bool(np.mean(bends[1:] * bends[:-1] < 0.0) > _JAGGED) if len(bends) > 1 else False


def _curves(model: LogModel) -> list[str]:
    """Inputs that act by a curve: behind that stands no port."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for name, states in model.curves.items():
        alike.setdefault(states, []).append(name)
    return [
        f"{'inputs' if len(names) > 1 else 'input'} {listed(names)}: the rate of {listed(states)} "
        f"goes with a curve of {'each' if len(names) > 1 else 'it'}. What lags behind that curve, "
        "as a motor behind the square of its command, has no port: state the curve as an input of "
        "its own, Input(…, law=…)."
        for states, names in alike.items()
    ]


def _heights(system: StateSpace) -> list[str]:
    """Ports whose position is a height by its name, and which do not say that it is one."""
    return [
        f"port {port.name}: ground-effect is not asked for; if {port.position} is the height above "
        f'the ground, say so: Port.force("{port.name}", …, height="{port.position}").'
        for port in system.ports
        if port.role == "force"
        and not port.height
        and (not port.kinds or _GROUND_EFFECT in port.kinds)
        and _HEIGHT.match(port.position)
        and same_dimension(system.states[port.position], "m")
    ]


def step_notes(model: LogModel, base: Fit) -> list[str]:
    """Outputs that finer steps of the model would move by more than their sensor's noise."""
    ends = np.cumsum([0, *(log.outputs.shape[1] for log in model.logs)])
    first, stop = max(itertools.pairwise(ends), key=lambda ends: ends[1] - ends[0])
    if model.system.has_step or stop - first <= _AHEAD:
        return []
    at = np.unique(np.linspace(first, stop - 1 - _AHEAD, _PLACES).astype(np.int64))
    acting = model.acting(())
    values = {name: np.array([v]) for name, v in model.values((), base.theta).items()}
    with np.errstate(all="ignore"):
        coarse, fine = (model.filter.advanced(acting, values, at, _AHEAD, k) for k in (1, _FINER))
        off = np.median(np.abs(fine - coarse), axis=1)  # an unstable state sends some far off
    return [
        f"{output.name}: the model's steps are too coarse; over {_AHEAD} samples they are off by "
        f"{error:.2g}{behind(output.unit)}, {ratio:.2g} times its noise. {_finer(model, ratio)}"
        for output, error in zip(model.system.outputs, off, strict=True)
        for noise in [float(np.exp(base.value(f"noise.{output.name}")))]
        for ratio in [float(error / noise)]
        if 1.0 < ratio < math.inf
    ]


def _finer(model: LogModel, ratio: float) -> str:
    """What to do about steps that are off by `ratio` times the noise: errors fall with squares."""
    wanted = model.system.steps * math.sqrt(2.0 * ratio)
    rows = model.logs[0].rows
    fitting = (k for k in range(2, MOST_STEPS + 1) if k % rows == 0 or rows % k == 0)
    steps = next((k for k in fitting if k >= wanted), None)
    return "Give it a higher `rate_hz`." if steps is None else f"State `steps = {steps}`."


def _duration(logs: Sequence[Log], dt_s: float) -> str:
    """How long logs are together."""
    return f"{dt_s * sum(log.outputs.shape[1] for log in logs):.3g} s"


def _ranges(model: LogModel) -> list[str]:
    """Where each column lies, in the system's unit: a wrong unit shows here first."""
    system = model.system
    named = [(f"input {i.name}", i.unit) for i in system.inputs]
    named += [(f"output {o.name}", o.unit) for o in system.outputs]
    every = np.concatenate([np.concatenate([log.inputs, log.outputs]) for log in model.logs], 1)
    # What columns.toml has in degrees is no number of degrees that was taken for radians.
    origins = [at for recording in model.recordings for at in recording.origins.items()]
    known = {name for name, origin in origins if origin.unit != "rad"}
    ends = zip(np.nanmin(every, axis=1), np.nanmax(every, axis=1), strict=True)
    return [
        f"{name}: {minus(f'{low:.4g}')} to {minus(f'{high:.4g}')}{behind(unit)}"
        f"{'' if name.split()[1] in known else _turned(high - low, unit)}"
        for (name, unit), (low, high) in zip(named, ends, strict=True)
    ]


def _turned(span: float, unit: str) -> str:
    """How many turns a range in radians is, from a few on: degrees that were taken for radians."""
    turns = span / (2.0 * np.pi)
    if unit != "rad" or turns < _MANY_TURNS:
        return ""
    return f", {turns:.0f} turns; if the log counts degrees, its unit is deg"


def _names(model: LogModel) -> list[str]:
    """Columns, states and constants whose names end in another unit than the system states."""
    stated = [("input", i.name, i.unit) for i in model.system.inputs]
    stated += [("output", o.name, o.unit) for o in model.system.outputs]
    shown = {o.name for o in model.system.outputs}
    stated += [("state", n, u) for n, u in model.system.states.items() if n not in shown]
    stated += [("constant", c.name, c.unit) for c in model.system.constants if c.unit]
    return [
        f"{what} {name} is taken {_taken_in(unit)}, and its name says {named}; is its unit right?"
        for what, name, unit in stated
        for named in [contradicted(name, unit)]
        if named is not None
    ]


def _limits(model: LogModel) -> list[str]:
    """Inputs that logs take far beyond their limits: those, or the column, have another unit."""
    notes = []
    for k, stated in enumerate(model.system.inputs):
        row = np.concatenate([log.inputs[k] for log in model.logs])
        low = -math.inf if stated.low is None else stated.low
        high = math.inf if stated.high is None else stated.high
        known = [end for end in (low, high) if math.isfinite(end)]
        limits = minus(" to ".join(f"{end:.4g}" for end in known))
        span = high - low if len(known) > 1 else max(map(abs, known), default=math.inf)
        if max(low - float(row.min()), float(row.max()) - high) > _OUTSIDE * span:
            notes.append(
                f"input {stated.name} goes from {minus(f'{row.min():.4g}')} to "
                f"{minus(f'{row.max():.4g}')}{behind(stated.unit)}, far beyond the limits that it "
                f"states, {limits}; is the column's unit right?"
            )
    return notes


def _constants(model: LogModel) -> list[str]:
    """Constants that no fit moves, that may turn, and that may not though their spread would."""
    constants = model.system.constants
    exact = [c.name for c in constants if c.spread == 0.0]
    notes = [f"taken as exact, for want of a spread: {', '.join(exact)}."] if exact else []
    if hidden := [c.name for c in constants if c.name in model.unshown]:
        notes.append(f"shown by no output of these logs, and not fitted: {', '.join(hidden)}.")
    notes += _unitless(model)
    notes += [
        f"constant {c.name} may be on either side of 0, from {minus(f'{c.low:.3g}')} to "
        f"{c.high:.3g}."
        for c in constants
        if c.spread > 0.0 and c.low is not None and c.high is not None and c.low < 0.0 < c.high
    ]
    return notes + [
        f"constant {c.name} keeps its sign, though its spread reaches beyond 0; state low and high "
        "if it may be on either side."
        for c in constants
        if c.keeps_sign and abs(c.value) < c.spread < math.inf
    ]


def _unitless(model: LogModel) -> list[str]:
    """Constants whose unit neither their name nor `unit` says."""
    system = model.system
    names = [
        c.name for c in system.constants if not c.unit and system.unit_of_constant(c.name) == "1"
    ]
    if not names:
        return []
    what, count = ("constants", "count") if len(names) > 1 else ("constant", "counts")
    return [
        f"{what} without a unit, and {count} as 1: {', '.join(names)}. End the name in the unit, "
        'as in arm_m, or state it: unit="m", or unit="1" for none.'
    ]


def _beginnings(model: LogModel) -> list[str]:
    """States whose beginning nothing shows, and that are not at rest where they begin."""
    rates = dict(zip(model.system.states, model.first_rates(), strict=True))
    return [
        f"state {name}: no output shows it, and `start` does not give it. It begins at 0, where it "
        f"is not at rest, give or take {model.sizes[name]:.3g}"
        f"{behind(model.system.states[name])}: if that is too little, give it by `start`, or say "
        "by start_spread how far from 0 it may be."
        for name in model.hidden
        if float(np.abs(rates[name]).max()) > _MOVING * model.sizes[f"d {name}"]
    ]


def _taken_in(unit: str) -> str:
    return f"in {unit}" if unit not in ("", "1") else "without a unit"


def _notes(what: str, values: FloatArray) -> list[str]:
    values = values[np.isfinite(values)]
    if np.ptp(values) == 0.0:
        return [f"{what} never changes: nothing can be learnt from it."]
    return [f"{what} {_staying(*end)}." for end in _at_ends(values, _STUCK)]


def _at_ends(values: FloatArray, least: float) -> list[tuple[str, float, float]]:
    """Which end, where, and the share of finite values there, if it is above `least`."""
    if len(np.unique(values)) <= _FEW_VALUES:
        return []
    ends = [
        (word, float(end), float(np.mean(values == end)))
        for word, end in (("most", values.max()), ("least", values.min()))
    ]
    return [e for e in ends if e[2] > least and e[2] * len(values) >= _FEWEST_STUCK]


def _staying(word: str, end: float, share: float) -> str:
    return f"is at its {word}, {minus(f'{end:.4g}')}, in {share:.1%} of the samples"


def _off_zero(stated: Input, values: FloatArray) -> list[str]:
    """An input whose values all lie on one side of 0, and far from it, as a servo's pulses do."""
    least, most = float(np.min(values)), float(np.max(values))
    nearest = min(abs(least), abs(most))
    if least * most <= 0.0 or nearest < most - least or least == most:
        return []
    return [
        f"input {stated.name} is never near 0: from {minus(f'{least:.4g}')} to "
        f"{minus(f'{most:.4g}')}{behind(stated.unit)}. A dead band, an asymmetry, a gain and a "
        "saturation are about 0; if the value at rest is another, take it off: by offset in "
        f"[columns.{stated.name}] of columns.toml, in your functions and in the limits of `Input`."
    ]


def _frozen(
    stated: Input, log: str, values: FloatArray, ends: tuple[float, float], dt_s: float
) -> list[str]:
    """An input that stands still in the midst of a log for much longer than it does elsewhere.

    At 0 it may be at rest, as it may before the first command and behind the last; at one of its
    `ends` it may be cut.
    """
    begins = np.flatnonzero(np.diff(values)) + 1
    lasts = np.diff(begins)
    if len(lasts) < _FEWEST_RUNS:
        return []
    longest = int(np.argmax(lasts))
    usual = float(np.quantile(lasts, _USUAL_RUN))
    value = float(values[begins[longest]])
    if value in (0.0, *ends) or lasts[longest] < _FROZEN * usual:
        return []
    return [
        f"input {stated.name} stands at {minus(f'{value:.4g}')}{behind(stated.unit)} in {log} for "
        f"{dt_s * lasts[longest]:.3g} s, from {dt_s * begins[longest]:.4g} s after its start, and "
        f"seldom for more than {dt_s * usual:.2g} s elsewhere. If it was not logged there, cut "
        "that out."
    ]


def _residual(moved: FloatArray, known: FloatArray, prior: FloatArray) -> FloatArray:
    """What is left of a change where known directions follow as their priors let them."""
    q, _ = np.linalg.qr(np.vstack([known, np.diag(prior)]))
    padded = np.concatenate([moved, np.zeros(len(prior))])
    return np.asarray(padded - q @ (q.T @ padded))[: len(moved)]


def _alike(names: Sequence[str], remaining: dict[str, FloatArray]) -> dict[str, tuple[str, ...]]:
    """Names whose remainders have nearly the same shape."""
    norm = {n: float(np.linalg.norm(remaining[n])) for n in names}
    there = [n for n in names if norm[n] > 0.0]
    alike: dict[str, tuple[str, ...]] = dict.fromkeys(names, ())
    for n in there:
        alike[n] = tuple(
            m for m in there
            if m != n and abs(float(remaining[n] @ remaining[m])) > LIKE * norm[n] * norm[m]
        )  # fmt: skip
    return alike
