"""`gap plan` and `gap power` of a user's own system."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.gap_system import open_model
from wakedeploy.cli.log_lines import stages
from wakedeploy.cli.output import print_table, write_json
from wakedeploy.core.errors import UnusableInput

if TYPE_CHECKING:
    from wakedeploy.gap.evidence.fits import Fit
    from wakedeploy.gap.systems.likelihood.logs import LogModel
    from wakedeploy.gap.systems.planning.plan import Plan
    from wakedeploy.gap.systems.planning.power import EffectPower

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
    from wakedeploy.gap.systems.files import read_system
    from wakedeploy.gap.systems.planning.known import stated_answer, stated_sizes
    from wakedeploy.gap.systems.planning.plan import plan
    from wakedeploy.gap.workflow import require_own

    answer = stated_answer(out)
    if out is not None and answer is not None:
        require_own(out, read_system(system_path).name)
    chosen = names or tuple(answer.rivals if answer else ())
    if not chosen and answer is not None and answer.effects:
        found = ", ".join(effect.name for effect in answer.effects)
        raise UnusableInput(
            f"{out}: no class is open, as the answer names {found}; say what else to look for: "
            "--class NAME."
        )
    if not chosen:
        raise UnusableInput(
            "Say what to look for: --class NAME, or --out with a class in name.json."
        )
    with stages() as progress:
        model, base = _fitted(system_path, measured, columns, progress, chosen)
        sizes = {} if out is None or answer is None else stated_sizes(out, answer, model, chosen)
        made = plan(model, base, chosen, sizes,
                    lambda done, of: progress("trying inputs", done, of))  # fmt: skip
    _tell(made, model.name)
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
    from wakedeploy.gap.systems.answers.folder import beside_answer
    from wakedeploy.gap.systems.planning.power import power

    with stages() as progress:
        model, base = _fitted(system_path, measured, columns, progress)
        if out is not None:
            model, base = beside_answer(model, base, out)
        if all(name in base.hypothesis for name in model.effects):
            raise UnusableInput(f"{out}: its answer has every effect that there is to ask for.")
        detectable = power(model, base, steps=lambda done, of: progress("trying effects", done, of))
    print_table(
        "The smallest size that logs like these tell, four times in five",
        ["effect", "of", "seen", "named", "nearest rival", "matters", "unit"],
        [_least(e) for e in detectable.effects],
    )  # fmt: skip
    click.echo(
        f"Seen: gains more than chance, {detectable.threshold_nats:.1f} nats. Named: also ahead of "
        "its nearest rival. Matters: removes a hundredth of the squared forecast error."
    )
    if base.hypothesis:
        click.echo(
            f"All this is beside what the answer in {out} has: {', '.join(base.hypothesis)}."
        )
    if detectable.missing is not None:
        name, nats = detectable.missing
        way = "run `gap close`, and give the folder of its answer about these logs as --out."
        if base.hypothesis:
            way = "the answer does not have all that is missing."
        click.echo(
            f"These logs lack something already: {name} or what looks like it would gain some "
            f"{nats:.0f} nats. Beside it every size comes out too large: {way}"
        )
    if out is not None:
        rows = [{k: _finite(v) for k, v in vars(e).items()} for e in detectable.effects]
        written = {"threshold_nats": detectable.threshold_nats, "effects": rows}
        written |= {"beside": list(base.hypothesis), "missing": detectable.missing}
        write_json(out / "power.json", written)
        click.echo(f"Written: {out / 'power.json'}")


def _least(effect: "EffectPower") -> list[str]:
    """A row of the table, in the words and units of people: of a limit to a rate, the rate."""
    from wakedeploy.gap.systems.answers.reader_units import sizes_as_read

    sizes = [effect.detected, effect.named, effect.matters, effect.largest]
    name, unit, (*shown, largest) = sizes_as_read(effect.name, effect.parameter, effect.unit, sizes)
    beyond = f"{'<' if name != effect.parameter else '>'} {_number(largest)}"
    seen, named, matters = (_number(s) if _number(s) != "-" else beyond for s in shown)
    return [effect.name, name, seen, named, effect.rival, matters, unit]


def _fitted(
    system_path: Path,
    measured: tuple[Path, ...],
    columns: Path | None,
    progress: Any,
    names: tuple[str, ...] = (),
) -> "tuple[LogModel, Fit]":
    """The model and its base fit; what cannot be asked for is said before it."""
    from wakedeploy.gap.search.judging import fitted_base
    from wakedeploy.gap.systems.planning.plan import require_names

    if not measured:
        raise click.UsageError("'--system' goes with '--measured', from which the noise is known.")
    progress("reading the logs")
    model = open_model(system_path, measured, columns)
    model.require_effects()
    if names:
        require_names(model, names)
    progress("fitting the system as it is")
    return model, fitted_base(model)


def _tell(made: "Plan", domain: str) -> None:
    from wakedeploy.gap.systems.planning.planned import planned
    from wakedeploy.gap.wording import quantity

    rows = [[o.excitation.name, ", ".join(o.moved),
             ", ".join(quantity(o.about[n], made.units[n]) for n in o.moved),
             f"{o.share:.0%}", f"{o.seconds:.0f}",
             f"{o.nats:.3g}", str(o.logs or "-"), o.excitation.description]
            for o in made.options[:_SHOWN]]  # fmt: skip
    title = "Nats by which the closest rival loses in one log"
    if len(made.names) == 1:
        title = f"Nats that {made.names[0]} gains in one log"
    if rows:
        print_table(
            title, ["input", "moves", "about", "of its limits", "s", "nats", "logs", ""], rows
        )
        click.echo("Nats count evidence: 3 make one twenty times as likely as the other.")
    click.echo(planned(made, domain).sentence)


def _write_input(path: Path, model: "LogModel", made: "Plan") -> None:
    """The best input as CSV, to be played to the system; that there is none is an answer, too."""
    import numpy as np

    from wakedeploy.gap.systems.planning.plan import commanded

    if made.best is None:
        click.echo(f"Not written: {path}, for no input is worth recording.")
        return
    best, names = made.best.columns, commanded(model)
    time_s = model.dt_s * np.arange(len(best[names[0]]))
    table = np.column_stack([time_s, *(best[n] for n in names)])
    np.savetxt(path, table, "%.9g", ",", header=",".join(["time_s", *names]), comments="")
    click.echo(f"Written: {path}")


def _row(option: Any) -> dict[str, Any]:
    labels = {"input": option.excitation.name, "description": option.excitation.description}
    kept = {k: getattr(option, k) for k in ("moved", "about", "share", "seconds", "nats", "logs")}
    return labels | kept


def _number(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) and value else "-"


def _finite(value: Any) -> Any:
    """JSON has no infinity."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
