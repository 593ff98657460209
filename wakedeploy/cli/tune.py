"""`wakedeploy tune`: search an architecture's hyper-parameters under the parameter budget."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import click
from click.core import ParameterSource

from wakedeploy.cli.names import ARCHITECTURE, PRESET
from wakedeploy.cli.output import (
    StageBars,
    json_option,
    print_table,
    stage_bars,
    told_when_stopped,
    write_json,
)
from wakedeploy.cli.training_options import device_option, lead_option
from wakedeploy.core.errors import UnusableInput

if TYPE_CHECKING:
    from trainers.tuning.conclude import Found
    from trainers.tuning.study import Study
    from trainers.tuning.workers import Work

_STOPPED = (
    "Stopped: the study in {} is kept, and what was in training will be begun again; the same"
    " command goes on."
)


def _list_dimensions(ctx: click.Context, param: click.Parameter, asked: bool) -> None:
    """Print what may be searched of each architecture, and end."""
    if not asked or ctx.resilient_parsing:
        return
    from trainers.build import ARCHITECTURES

    rows = [[arch, "  ".join(map(str, known.dimensions))] for arch, known in ARCHITECTURES.items()]
    print_table(
        "what each architecture's search changes; …_s in shares of the set's window",
        ["architecture", "dimensions"],
        rows,
    )
    ctx.exit()


@click.command()
@click.option("--data", type=click.Path(path_type=Path), required=True, help="An episode set.")
@click.option("--arch", type=ARCHITECTURE, required=True, help="One architecture.")
@click.option(
    "--trials",
    type=click.IntRange(1, 1_000_000),
    default=100,
    show_default=True,
    help="Finished in all: pruned and failed ones count, interrupted ones do not.",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="A folder. Default: tuned/DOMAIN-ARCH.",
)
@click.option("--seed", type=click.IntRange(0, 2**31), default=100, show_default=True,
              help="Of every trial; not one that `train --seeds` then scores.")  # fmt: skip
@click.option("--epochs", type=click.IntRange(1, 100_000), default=60, show_default=True)
@lead_option
@click.option(
    "--budget",
    type=click.IntRange(1, 100_000),
    default=100_000,
    show_default=True,
    help="Trials have fewer trainable weights than this.",
)
@click.option(
    "--objective",
    default="rmse",
    show_default=True,
    help="rmse, or with a cost: rmse,latency (p99 of the exported step), rmse,flash, rmse,ram or"
    " rmse,instructions (of its C on a microcontroller).",
)
@click.option(
    "--dimension",
    "dimensions",
    multiple=True,
    metavar="NAME=LOW:HIGH|NAME=A,B,…",
    help="Narrow or fix one of the architecture's dimensions; may be repeated.",
)
@click.option(
    "--list-dimensions",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_list_dimensions,
    help="Print each architecture's dimensions and their bounds, and end.",
)
@click.option(
    "--start",
    "starts",
    type=PRESET,
    multiple=True,
    metavar="PRESET",
    help="A preset's file, or tuned (what ships): one of the first trials; may be repeated. The"
    " paper's shape is one where the dimensions hold it.",
)
@click.option(
    "--pruner",
    type=click.Choice(["median", "hyperband", "none"], case_sensitive=False),
    default="median",
    show_default=True,
    help="What ends a trial that is behind; not with two objectives.",
)
@click.option(
    "--workers",
    type=click.IntRange(1, 256),
    default=1,
    show_default=True,
    help="Processes that share the study; they disturb each other's latency.",
)
@click.option(
    "--storage",
    metavar="URL",
    help="postgresql://USER@HOST/DATABASE, for many machines (the password may come from PGPASSWORD"
    " or ~/.pgpass). Default: a journal file in --out.",
)
@click.option("--study-name", help="Default: DOMAIN-ARCH.")
@device_option
@click.option(
    "--give-up-elsewhere",
    is_flag=True,
    help="Begin again what other machines were training: for those that will not come back.",
)
@json_option
def command(
    data: Path,
    arch: str,
    trials: int,
    out: Path | None,
    seed: int,
    epochs: int,
    lead_s: float | None,
    budget: int,
    objective: str,
    dimensions: tuple[str, ...],
    starts: tuple[str, ...],
    pruner: Literal["median", "hyperband", "none"],
    workers: int,
    storage: str | None,
    study_name: str | None,
    device: str,
    give_up_elsewhere: bool,
    json_path: Path | None,
) -> None:
    """Search hyper-parameters by Bayesian optimisation, judged on the validation episodes.

    A trial over the parameter budget is not trained. The same command goes on where it was stopped,
    more --trials add to it, and several may run at once. --out then holds best.toml, the best
    trial's run, trials.csv and figures; test episodes are looked at once, for the best.

    \b
    Example:
        wakedeploy tune --arch gru --data sets/gantry --trials 100 --out tuned/gru
        wakedeploy tune --arch tcn --data sets/fish --out tuned/tcn --dimension blocks=2:5 \\
            --objective rmse,latency --workers 4
        wakedeploy train --preset tuned/gru/best.toml --data sets/gantry
    """
    from wakedeploy.api.tuning import tune

    _require_of_use(arch, objective)
    begun: list[Work] = []
    with told_when_stopped(lambda: _stopped(begun)), stage_bars() as bars:
        tuned = tune(
            data,
            arch,
            trials=trials,
            out=out,
            seed=seed,
            epochs=epochs,
            lead_s=lead_s,
            budget=budget,
            objective=objective,
            dimensions=dimensions,
            starts=starts,
            pruner=pruner,
            workers=workers,
            storage=storage,
            study_name=study_name,
            device=device,
            give_up_elsewhere=give_up_elsewhere,
            progress=bars,
            on_begun=begun.append,
            on_trials=lambda study: _show(study, bars, trials),
        )
    _tell(tuned.found, tuned.work, tuned.study, json_path)


def _require_of_use(arch: str, objective: str) -> None:
    """Refuse options that would change nothing."""
    source_of = click.get_current_context().get_parameter_source
    given = [
        name for name in ("pruner", "epochs") if source_of(name) == ParameterSource.COMMANDLINE
    ]
    if given and _is_solved(arch):
        raise UnusableInput(
            f"--{given[0]}: {arch} is solved in one pass, not in epochs; leave it out."
        )
    if "pruner" in given and "," in objective:
        raise UnusableInput(
            "--pruner: with two objectives no trial is ended early; leave it out, or judge by rmse."
        )


def _is_solved(arch: str) -> bool:
    from trainers.build import ARCHITECTURES

    return ARCHITECTURES[arch].solved


def _stopped(begun: "list[Work]") -> str:
    """How to go on, where there is something to go on with."""
    return _STOPPED.format(begun[0].place.name) if begun else "Interrupted."


def _show(study: "Study", bars: StageBars, trials: int) -> None:
    """How many trials are done, and the best of them, before the bar."""
    from trainers.tuning.report import best_so_far
    from trainers.tuning.study import all_trials, finished

    done, best = len(finished(all_trials(study))), best_so_far(study)
    score = "" if best is None else f", best {best[1]:.4g} (trial {best[0]})"
    bars("Trials", min(done, trials), trials)
    bars.describe(f"{done} of {trials} trials{score}")


def _tell(found: "Found", work: "Work", study: "Study", json_path: Path | None) -> None:
    from trainers.tuning.plan import COSTS

    plan, best, run = work.plan, found.best, found.run
    if json_path:
        write_json(json_path, _as_json(found, work, study))
    said = ", ".join(f"{count} {state}" for state, count in found.counts.items())
    title = f"{plan.arch} on {plan.domain}, study in {work.place.name}: {said}"
    shown = found.front if plan.cost is not None else [best]
    reference = [row for row in found.rows if row.reference and row.error is not None]
    rows = [
        [
            f"{row.number}{' (the paper’s shape)' if row.reference else ''}",
            f"{row.error:.4g}",
            *([f"{row.cost:.0f}"] if row.cost is not None else []),
            f"{row.parameters:,}",
            " ".join(f"{name}={_short(value)}" for name, value in row.point.items()),
        ]
        for row in [*shown, *(row for row in reference if row not in shown)]
    ]
    cost = [] if plan.cost is None else [COSTS[plan.cost]]
    columns = ["trial", "validation error", *cost, "trainable", "point"]
    print_table(title, columns, rows)
    errors = [
        f"{c.name} {run.metrics.test.rmse[c.name]:.4g} {c.unit}"
        + _share(run.metrics.test.r2[c.name])
        for c in run.config.force
    ]
    click.echo(f"Test RMSE of trial {best.number}, trained once more: {', '.join(errors)}.")
    click.echo(f"{work.out / 'best.toml'}: train with it by `wakedeploy train --preset`.")
    if found.elsewhere:
        hosts = ", ".join(sorted(set(found.elsewhere)))
        click.echo(
            f"Still in training on {hosts}: {len(found.elsewhere)} of the trials; the same command"
            " counts them in when they are done, and with --give-up-elsewhere begins again what"
            " other machines will not finish."
        )


def _short(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.3g}"


def _share(r2: float | None) -> str:
    return "" if r2 is None else f" (R² {r2:.4f})"


def _as_json(found: "Found", work: "Work", study: "Study") -> dict[str, Any]:
    """The result for other programs; errors as in best.toml, RMSE in the channels' units."""
    import dataclasses

    from trainers.tuning.plan import described

    metrics = found.run.metrics
    return {
        **described(work.plan, work.data),
        "study": study.study_name,
        "storage": work.place.name,
        "trials": found.counts,
        "best": dataclasses.asdict(found.best),
        "hyper": found.run.config.hyper,
        "settings": found.run.config.settings,
        "device": metrics.device,
        "front": [dataclasses.asdict(row) for row in found.front],
        "importances": dict(found.importances),
        "validation": {"rmse": metrics.validation.rmse, "r2": metrics.validation.r2},
        "test": {"rmse": metrics.test.rmse, "r2": metrics.test.r2},
        "rows": [dataclasses.asdict(row) for row in found.rows],
    }
