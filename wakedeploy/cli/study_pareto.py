"""`wakedeploy study pareto`: what accuracy costs in parameters and in the loop's time."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from wakedeploy.cli.output import print_table, progress
from wakedeploy.cli.study_options import (
    Asked,
    domains_option,
    recordings_option,
    sets_of,
    study_options,
    train_with_bar,
    write_page,
)
from wakedeploy.cli.training_options import architectures_option

if TYPE_CHECKING:
    from wakedeploy.study.pareto import Point

_QUICK_TICKS = 128


@click.command("pareto")
@domains_option
@architectures_option()
@click.option(
    "--ticks",
    type=click.IntRange(64),
    default=1024,
    show_default=True,
    help="Of the loop with each model, at 32 a second, in four rounds; 128 with --quick.",
)
@recordings_option("quadrotor", "fish", "crazyflie")
@study_options
def pareto(
    names: tuple[str, ...], arch: tuple[str, ...], ticks: int, recordings: Path | None, asked: Asked
) -> None:
    """Set each architecture's error against its parameters and against its step's time.

    The step is timed in the loop, paced at 32 Hz, as `bench latency` does it: 50 s for each
    model and domain, in four rounds, on a machine that should do nothing else meanwhile. The
    p99 is of a round's ticks; where the rounds of two models overlap, their steps count as equal.
    Trains what `study domains` has not trained into the same folder yet.

    \b
    Example:
        wakedeploy study pareto --recordings ../data --seeds 3 --out study
        wakedeploy study pareto --domains gantry --arch agile-mlp,gru --quick
    """
    from wakedeploy.study.domains import compare, planned
    from wakedeploy.study.pareto import measure, sentence, unlearned
    from wakedeploy.study.pareto_figure import parts, summary

    architectures = list(arch)
    sets = sets_of(names, recordings, asked)
    ticks = _QUICK_TICKS if asked.quick else ticks
    train_with_bar(
        [
            (made, wanted)
            for made in sets.values()
            for wanted in planned(made, architectures, asked.seeds, asked.epochs, blinded=False)
        ],
        asked.runs,
    )
    by_domain: dict[str, list[Point]] = {}
    beside: dict[str, dict[str, float]] = {}
    for name, made in sets.items():
        with progress(f"{name}: scoring", 1):
            lines = compare(
                made, architectures, asked.seeds, asked.runs, epochs=asked.epochs, blinded=False
            )
        beside[name] = unlearned(lines)
        with progress(f"{name}: flying at 32 Hz", len(architectures) * ticks) as bar:
            by_domain[name] = measure(made, lines, asked.runs, ticks=ticks, on_tick=bar.update)
    points = [point.as_json() for of_domain in by_domain.values() for point in of_domain]
    result = {"quick": asked.quick, "seeds": asked.seeds, "ticks": ticks, "points": points}
    result |= {"unlearned": beside}
    title = asked.titled("What accuracy costs")
    folder = asked.results("pareto", names)
    path = write_page(folder, title, lambda: parts(by_domain, beside), result, [*sets.values()])
    for name, of_domain in by_domain.items():
        print_table(sentence(name, of_domain), *summary(of_domain, beside[name]))
    click.echo(f"Figures, tables and the page: {path}")
