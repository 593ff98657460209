"""`wakedeploy study`: the paper's comparisons, each one command."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.groups import Group
from wakedeploy.cli.output import print_table, progress
from wakedeploy.cli.study_delay import basin, delay, fish_scatter
from wakedeploy.cli.study_horizon import lead, window
from wakedeploy.cli.study_options import (
    Asked,
    domains_option,
    recordings_option,
    sets_of,
    study_options,
    train_with_bar,
    write_page,
)
from wakedeploy.cli.study_pareto import pareto
from wakedeploy.cli.training_options import architectures_option

if TYPE_CHECKING:
    from wakedeploy.core.episodes import EpisodeSet
    from wakedeploy.study.closed_loop import Model
    from wakedeploy.study.domains import Line


def _flights_option(quick: str) -> Callable[..., Any]:
    """`--flights` of the 2D simulator; `quick` says what a quick look flies."""
    return click.option(
        "--flights",
        type=click.IntRange(2, 1000),
        default=16,
        show_default=True,
        help=f"Flights of 20 s; {quick} with --quick.",
    )


@click.group(cls=Group)
def command() -> None:
    """Repeat the paper's comparisons: tables, figures and a page for each.

    \b
    Example:
        wakedeploy study domains --recordings ../data --out study
        wakedeploy study closed-loop --quick
    """


@command.command("domains")
@domains_option
@architectures_option()
@recordings_option("quadrotor", "fish", "crazyflie")
@study_options
def domains(
    names: tuple[str, ...], arch: tuple[str, ...], recordings: Path | None, asked: Asked
) -> None:
    """Compare the architectures over the domains, on episodes never trained on.

    A stopped study goes on where it was. Domains whose recordings are not there are left out.

    \b
    Example:
        wakedeploy study domains --recordings ../data --seeds 3 --out study
        wakedeploy study domains --domains gantry,ship --arch agile-mlp,gru --quick
    """
    from wakedeploy.study.domains import compare, planned
    from wakedeploy.study.domains_figure import parts, summary
    from wakedeploy.study.domains_sentence import sentence

    architectures = list(arch)
    sets = sets_of(names, recordings, asked)
    by_domain: dict[str, list[Line]] = {}
    jobs = [
        (made, wanted)
        for made in sets.values()
        for wanted in planned(made, architectures, asked.seeds, asked.epochs)
    ]
    train_with_bar(jobs, asked.runs)
    with progress("Scoring", len(sets)) as bar:
        for name, made in sets.items():
            by_domain[name] = compare(
                made, architectures, asked.seeds, asked.runs, epochs=asked.epochs
            )
            bar.advance()
    lines = [line.as_json() for runs in by_domain.values() for line in runs]
    result = {"quick": asked.quick, "seeds": asked.seeds, "lines": lines}
    title = asked.titled("The architectures over the domains")
    folder = asked.results("domains", names)
    path = write_page(folder, title, lambda: parts(by_domain), result, [*sets.values()])
    for name, runs in by_domain.items():
        print_table(f"{name}: {sentence(name, runs)}", *summary(runs))
    click.echo(f"Figures, tables and the page: {path}")


@command.command("closed-loop")
@architectures_option()
@_flights_option("4 of 5 s")
@study_options
def closed_loop(arch: tuple[str, ...], flights: int, asked: Asked) -> None:
    """Fly the 2D simulator with no compensation, with the truth and with each architecture.

    Trains what `study domains` has not trained into the same folder yet.

    \b
    Example:
        wakedeploy study closed-loop --seeds 3 --out study
        wakedeploy study closed-loop --arch agile-mlp,gru --quick
    """
    from wakedeploy.study.closed_loop import LIMITS, mean_force, sentence, track
    from wakedeploy.study.closed_loop_figure import parts, summary

    architectures = list(arch)
    data = sets_of(("downwash",), None, asked)["downwash"]
    models, chosen = _models(data, architectures, asked)
    count, seconds = (4, 5.0) if asked.quick else (flights, 20.0)
    with progress("Flying", len(LIMITS) + len(architectures) * asked.seeds) as bar:
        lines = track(models, count, seconds, constant=mean_force(data), on_flight=bar.advance)
    result: dict[str, Any] = {"quick": asked.quick, "flights": count, "seconds": seconds}
    result |= {"rms_m": {line.name: line.rms_m.tolist() for line in lines}}
    title = asked.titled("Closed loop on the 2D downwash simulator")
    folder = asked.results("closed-loop")
    path = write_page(folder, title, lambda: parts(lines, chosen), result, [data])
    print_table(sentence(lines, chosen), *summary(lines))
    click.echo(f"Figures, tables and the page: {path}")


@command.command("shift")
@architectures_option()
@_flights_option("2 of 4 s")
@study_options
def shift(arch: tuple[str, ...], flights: int, asked: Asked) -> None:
    """Train where the physics varies by ±10 %, and fly where it varies by ±10, ±50 and ±75 %.

    Wake speed, diffusivity and separation differ from flight to flight; no model is told. Beside
    them, what `study domains` trained in the nominal physics flies there.

    \b
    Example:
        wakedeploy study shift --seeds 3 --out study
        wakedeploy study shift --arch agile-mlp,gru --quick
    """
    from wakedeploy.study.closed_loop import LIMITS, mean_force
    from wakedeploy.study.shift import FLOWN, TRAINED, Crew, fly_shifted, sentence, spread_set
    from wakedeploy.study.shift_figure import parts, summary

    architectures = list(arch)
    plain = sets_of(("downwash",), None, asked)["downwash"]
    with progress("Flying what is learned from", 1) as bar:
        varied = spread_set(asked.out / "sets", quick=asked.quick, progress=bar.update)
    models, chosen = _models(varied, architectures, asked)
    trained = Crew(models, mean_force(varied))
    crews = {0.0: Crew(_models(plain, architectures, asked)[0], mean_force(plain))}
    crews |= dict.fromkeys(FLOWN, trained)
    count, seconds = (2, 4.0) if asked.quick else (flights, 20.0)
    with progress("Flying", len(crews) * (len(LIMITS) + len(models) * asked.seeds)) as bar:
        nominal, *spreads = fly_shifted(crews, count, seconds, on_flight=bar.advance)
    result: dict[str, Any] = {"quick": asked.quick, "flights": count, "seconds": seconds}
    result |= {"trained": {"0": "nominal", "others": TRAINED}}
    result["rms_m"] = {
        f"{shifted.spread:g}": {line.name: line.rms_m.tolist() for line in shifted.lines}
        for shifted in (nominal, *spreads)
    }
    title = asked.titled("Trained on one physics, flown in another")
    folder = asked.results("shift")
    path = write_page(
        folder, title, lambda: parts(nominal, spreads, chosen), result, [plain, varied]
    )
    print_table(sentence(nominal, spreads, chosen), *summary(nominal, spreads))
    click.echo(f"Figures, tables and the page: {path}")


def _models(
    data: "EpisodeSet", architectures: list[str], asked: Asked
) -> "tuple[list[Model], str]":
    """Each architecture's predictors, one per seed, and which is the best on validation."""
    from wakedeploy.study.closed_loop import Model
    from wakedeploy.study.runs import Wanted, best_run, candidates

    wanted = {a: [Wanted(a, s, asked.epochs) for s in range(asked.seeds)] for a in architectures}
    jobs = [
        (data, candidate) for seeds in wanted.values() for w in seeds for candidate in candidates(w)
    ]
    train_with_bar(jobs, asked.runs)
    runs = {a: [best_run(data, w, asked.runs) for w in seeds] for a, seeds in wanted.items()}
    losses = {a: sum(min(run.metrics.history) for run, _ in tried) for a, tried in runs.items()}
    models = [
        Model(a, [run.predictor for run, _ in tried], [w.hyper_text for _, w in tried])
        for a, tried in runs.items()
    ]
    return models, min(losses, key=lambda a: losses[a])


for _command in (delay, basin, fish_scatter, window, lead, pareto):
    command.add_command(_command)
