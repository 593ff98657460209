"""`gap plan` and `gap power` of a user's own system."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.gap_system import open_model
from wakedeploy.cli.log_lines import stages
from wakedeploy.cli.output import print_table, write_json
from wakedeploy.core.errors import CheckFailed, UnusableInput

if TYPE_CHECKING:
    from wakedeploy.gap.evidence.fits import Fit
    from wakedeploy.gap.search.artefacts import Answer
    from wakedeploy.gap.systems.logs import LogModel
    from wakedeploy.gap.systems.planning.plan import Plan

NAME = "name.json"
_ANEW = "run `wakedeploy gap name` anew, with the same --system, --measured and --out"
_SHOWN = 8  # inputs


def run_plan(
    system_path: Path,
    measured: tuple[Path, ...],
    columns: Path | None,
    names: tuple[str, ...],
    out: Path | None,
    input_path: Path | None,
    json_path: Path | None,
) -> None:
    """Which input to record next, on the terminal and as files."""
    from wakedeploy.gap.systems.planning.plan import plan

    answer = stated_answer(out)
    chosen = names or tuple(answer.rivals if answer else ())
    if not chosen:
        raise UnusableInput(
            "Say what to look for: --class NAME, or --out with a class in name.json."
        )
    with stages() as progress:
        model, base = _fitted(system_path, measured, columns, progress)
        sizes = {} if out is None or answer is None else stated_sizes(out, answer, model, chosen)
        made = plan(model, base, chosen, sizes,
                    lambda done, of: progress("trying inputs", done, of))  # fmt: skip
    _tell(made)
    if json_path is not None:
        best = None if made.best is None else _row(made.best)
        write_json(json_path, {"names": made.names, "logged_nats": made.logged_nats, "best": best,
                               "options": [_row(o) for o in made.options]})  # fmt: skip
    if input_path is not None:
        _write_input(input_path, model, made)


def run_power(
    system_path: Path, measured: tuple[Path, ...], columns: Path | None, out: Path | None
) -> None:
    """How large effects have to be, on the terminal and in a folder."""
    from wakedeploy.gap.systems.planning.power import power

    with stages() as progress:
        model, base = _fitted(system_path, measured, columns, progress)
        detectable = power(model, base, steps=lambda done, of: progress("trying effects", done, of))
    print_table(
        "The smallest size that logs like these tell, four times in five",
        ["effect", "of", "seen", "named", "nearest rival", "matters", "unit"],
        [[e.name, e.parameter, _number(e.detected), _number(e.named), e.rival,
          _number(e.matters), e.unit] for e in detectable.effects],
    )  # fmt: skip
    click.echo(
        f"Seen: gains more than chance, {detectable.threshold_nats:.1f} nats. Named: also ahead of "
        "its nearest rival. Matters: removes a hundredth of the squared forecast error."
    )
    if out is not None:
        rows = [{k: _finite(v) for k, v in vars(e).items()} for e in detectable.effects]
        write_json(
            out / "power.json", {"threshold_nats": detectable.threshold_nats, "effects": rows}
        )
        click.echo(f"Written: {out / 'power.json'}")


def _fitted(
    system_path: Path, measured: tuple[Path, ...], columns: Path | None, progress: Any
) -> "tuple[LogModel, Fit]":
    from wakedeploy.gap.search.judging import fitted_base

    if not measured:
        raise click.UsageError("'--system' goes with '--measured', from which the noise is known.")
    progress("reading the logs")
    model = open_model(system_path, measured, columns)
    progress("fitting the system as it is")
    return model, fitted_base(model)


def stated_answer(out: Path | None) -> "Answer | None":
    """What `gap name` left in a folder; None without one.

    Raises UnusableInput where it left nothing that can be read.
    """
    from wakedeploy.core.files import json_of, text_of
    from wakedeploy.gap.search.artefacts import Answer, stated

    if out is None:
        return None
    path = out / NAME
    try:
        content = json_of(text_of(path))
    except (OSError, ValueError) as error:
        raise UnusableInput(f"{path} cannot be read; {_ANEW}.") from error
    if not isinstance(content, dict):
        raise UnusableInput(f"{path} has no answer; {_ANEW}.")
    return stated(path, content, Answer, _ANEW)


def stated_sizes(
    out: Path, answer: "Answer", model: "LogModel", names: tuple[str, ...]
) -> dict[str, tuple[float, ...]]:
    """The parameters of the effects as the last round that ranked them fitted them.

    Raises UnusableInput for an effect of the answer that the system does not have, and for one
    that is ranked without values that its parameters can have.
    """
    path = out / NAME
    for name in answer.rivals:
        if name not in model.effects:
            raise UnusableInput(f"{path}: {name!r} is no effect of {model.name}; {_ANEW}.")
    ranking = {e.name: e.parameters for r in answer.rounds for e in r.ranking}
    sizes = {}
    for name in names:
        if name not in ranking or name not in model.effects:
            continue
        for free in model.effects[name]:
            size = ranking[name].get(free.name)
            if size is None or not free.low <= size.value <= free.high:  # false for NaN, too
                raise UnusableInput(
                    f"{path}: {free.name} has no value between {free.low:g} and {free.high:g}; "
                    f"{_ANEW}."
                )
        sizes[name] = tuple(ranking[name][free.name].value for free in model.effects[name])
    return sizes


def _tell(made: "Plan") -> None:
    rows = [[o.excitation.name, ", ".join(o.moved), f"{o.share:.0%}", f"{o.seconds:.0f}",
             f"{o.nats:.3g}", str(o.logs or "-"), o.excitation.description]
            for o in made.options[:_SHOWN]]  # fmt: skip
    title = "Nats by which the closest rival loses in one log"
    if len(made.names) == 1:
        title = f"Nats that {made.names[0]} gains in one log"
    print_table(title, ["input", "moves", "of its limits", "s", "nats", "logs", ""], rows)
    best = made.best
    if best is None:
        richest = max((option.nats for option in made.options), default=0.0)
        click.echo(
            f"Record none of these: the best tells {richest:.3g} nats in one log, and as much of "
            f"the present logs has {made.logged_nats:.3g}. If those do not decide it, such a log "
            "hardly will. Check columns and units, widen the limits, or add a sensor."
        )
        return
    click.echo(
        f"Record {best.excitation.name} on {', '.join(best.moved)}: {best.nats:.3g} nats in "
        f"{best.seconds:.0f} s, where as much of the present logs has {made.logged_nats:.3g}."
    )


def _write_input(path: Path, model: "LogModel", made: "Plan") -> None:
    """The best input as CSV, to be played to the system."""
    import numpy as np

    if made.best is None:
        raise CheckFailed(f"{path}: not written, for no input is worth recording.")
    best = made.best.columns
    names = [i.name for i in model.system.inputs]
    time_s = model.dt_s * np.arange(len(best[names[0]]))
    table = np.column_stack([time_s, *(best[n] for n in names)])
    np.savetxt(path, table, "%.9g", ",", header=",".join(["time_s", *names]), comments="")
    click.echo(f"Written: {path}")


def _row(option: Any) -> dict[str, Any]:
    labels = {"input": option.excitation.name, "description": option.excitation.description}
    kept = {k: getattr(option, k) for k in ("moved", "share", "seconds", "nats", "logs")}
    return labels | kept


def _number(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "-"


def _finite(value: Any) -> Any:
    """JSON has no infinity."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
