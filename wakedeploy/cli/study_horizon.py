"""`wakedeploy study window` and `study lead`: how far back to look, and how far ahead."""

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
    from wakedeploy.study.lead import Point
    from wakedeploy.study.window import Seen


@click.command("window")
@domains_option
@architectures_option("history-mlp,gru")
@recordings_option("quadrotor", "fish", "crazyflie")
@study_options
def window(
    names: tuple[str, ...], arch: tuple[str, ...], recordings: Path | None, asked: Asked
) -> None:
    """Find the shortest past that a predictor has to see, domain by domain.

    Window models are trained for every length, from none (agile-mlp) to 1.5 of the domain's usual
    window; recurrent ones are trained once and their past is cut, which tells what they need at
    most. A stopped study goes on.

    \b
    Example:
        wakedeploy study window --recordings ../data --seeds 3 --out study
        wakedeploy study window --domains downwash --quick
    """
    from wakedeploy.study.sets import DOMAINS
    from wakedeploy.study.window import (
        measure,
        planned,
        sentence,
        transport_delay_s,
        with_memory,
    )
    from wakedeploy.study.window_figure import needed, parts

    architectures = with_memory(list(arch))
    sets = sets_of(names, recordings, asked)
    jobs = [
        job
        for made in sets.values()
        for job in planned(made, architectures, asked.seeds, asked.epochs)
    ]
    train_with_bar(jobs, asked.runs)
    by_domain: dict[str, list[Seen]] = {}
    mains = {name: DOMAINS[name].main for name in sets}
    with progress("Scoring", len(sets)) as bar:
        for name, made in sets.items():
            by_domain[name] = measure(
                made, mains[name], architectures, asked.seeds, asked.runs, epochs=asked.epochs
            )
            bar.advance()
    points = [point.as_json() for seen in by_domain.values() for point in seen]
    result = {"quick": asked.quick, "seeds": asked.seeds, "channels": mains, "points": points}
    rates_hz = {name: made.rate_hz for name, made in sets.items()}
    title = asked.titled("How much of the past a predictor has to see")
    delays_s = {name: transport_delay_s(made) for name, made in sets.items()}
    folder, drawn = asked.results("window", names), (by_domain, mains, rates_hz, delays_s)
    path = write_page(folder, title, lambda: parts(*drawn), result, [*sets.values()])
    print_table("The shortest past that suffices", *needed(by_domain))
    for name, seen in by_domain.items():
        click.echo(sentence(name, seen, rates_hz[name], delays_s[name]))
    click.echo(f"Figures, tables and the page: {path}")


@click.command("lead")
@architectures_option("agile-mlp,history-mlp,gru")
@click.option("--flights", type=click.IntRange(2, 1000), default=8, show_default=True)
@study_options
def lead(arch: tuple[str, ...], flights: int, asked: Asked) -> None:
    """Find how far ahead to predict the force, on the gantry and on the 2D downwash simulator.

    Trains each architecture at each lead, scores the force and flies it on unseen seeds, beside no
    compensation and the true force at the same leads. A stopped study trains nothing twice.

    \b
    Example:
        wakedeploy study lead --seeds 3 --out study
        wakedeploy study lead --arch agile-mlp,gru --quick
    """
    from wakedeploy.study import lead as study
    from wakedeploy.study.lead import DOMAINS, LEADS_S, QUICK_LEADS_S, sentence
    from wakedeploy.study.lead_figure import parts, summary
    from wakedeploy.study.sets import DOMAINS as SETS

    architectures = list(arch)
    sets = sets_of(DOMAINS, None, asked)
    leads_s = QUICK_LEADS_S if asked.quick else LEADS_S
    count, seconds = (2, 6.0) if asked.quick else (flights, 20.0)
    lines = study.asked(architectures, leads_s, asked.seeds, asked.epochs)
    runs = asked.runs / "lead"  # trained for fewer epochs than the other studies' runs
    train_with_bar([job for made in sets.values() for job in study.planned(made, lines)], runs)
    by_domain: dict[str, list[Point]] = {}
    with progress("Flying", len(sets) * (1 + len(leads_s) + len(lines))) as bar:
        for name, made in sets.items():
            by_domain[name] = study.measure(
                made,
                SETS[name].main,
                lines,
                leads_s,
                runs,
                flights=count,
                seconds=seconds,
                on_flown=bar.advance,
            )
    points = [vars(point) for at_leads in by_domain.values() for point in at_leads]
    result = {"quick": asked.quick, "flights": count, "seconds": seconds, "points": points}
    title = asked.titled("How far ahead to predict the force")
    folder = asked.results("lead")
    path = write_page(folder, title, lambda: parts(by_domain), result, [*sets.values()])
    for name, at_leads in by_domain.items():
        print_table(sentence(name, at_leads), *summary(at_leads))
    click.echo(f"Figures, tables and the page: {path}")
