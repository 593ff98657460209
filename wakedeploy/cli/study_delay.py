"""Three studies of `wakedeploy study`: delays, their basins of attraction, the fish's scatter."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

import click

from wakedeploy.cli.output import print_table, progress
from wakedeploy.cli.study_options import (
    Asked,
    recordings_option,
    sets_of,
    study_options,
    train_with_bar,
    write_page,
)

if TYPE_CHECKING:
    from wakedeploy.core.episodes import EpisodeSet
    from wakedeploy.study.delay import Case

_SIMULATED = ("downwash", "gantry")


@click.command("delay")
@study_options
def delay(asked: Asked) -> None:
    """Compare where models look back to with how long the wake is on its way.

    Cross-Attention's weights on the downwash and on the gantry; Delay Embedding's delays for five
    separations of the one and five wake speeds of the other, each trained from near both
    ends of the window.

    \b
    Example:
        wakedeploy study delay --seeds 3 --out study
        wakedeploy study delay --quick
    """
    from wakedeploy.study import delay as study
    from wakedeploy.study.delay_figure import (
        attention_sentence,
        attention_summary,
        delay_sentence,
        delay_summary,
        parts,
    )
    from wakedeploy.study.sets import DOMAINS

    whole = sets_of(_SIMULATED, None, asked)
    nominal = [(study.nominal(name, DOMAINS[name]), made) for name, made in whole.items()]
    varied = [(case, _made(case, asked)) for case in study.cases(quick=asked.quick)]
    attending = study.planned(study.ATTENDING, asked.seeds, asked.epochs)
    jobs = [(made, wanted) for _, made in nominal for wanted in attending]
    jobs += [
        (made, wanted)
        for _, made in varied
        for wanted in study.planned_delays(made, asked.seeds, asked.epochs)
    ]
    train_with_bar(jobs, asked.runs)
    common = (asked.seeds, asked.runs, asked.epochs)
    looks, lines = [], []
    with progress("Looking where models look", len(nominal) + len(varied)) as bar:
        for case, made in nominal:
            looks.append(study.attended(case, made, *common))
            bar.advance()
        for case, made in varied:
            lines += study.learned(case, made, *common)
            bar.advance()
    result = {
        "quick": asked.quick,
        "seeds": asked.seeds,
        "attention": [look.as_json() for look in looks],
        "delays": [dataclasses.asdict(line) for line in lines],
        "trends": {
            name: {of: dataclasses.asdict(study.trend(chosen, of)) for of in study.TRENDS}
            for name in _SIMULATED
            if (chosen := study.best([line for line in lines if line.domain == name]))
        },
    }
    title = asked.titled("Learned and physical delays")
    used = [made for _, made in (*nominal, *varied)]
    path = write_page(asked.results("delay"), title, lambda: parts(looks, lines), result, used)
    print_table(attention_sentence(looks), *attention_summary(looks))
    print_table(delay_sentence(lines), *delay_summary(lines))
    click.echo(f"Figures, tables and the page: {path}")


@click.command("basin")
@recordings_option("fish")
@study_options
def basin(recordings: Path | None, asked: Asked) -> None:
    """Start Delay Embedding from many delays and see where it ends, on the fish recordings.

    \b
    Example:
        wakedeploy study basin --recordings ../data --seeds 3 --out study
        wakedeploy study basin --recordings ../data --quick
    """
    from wakedeploy.study import basin as study
    from wakedeploy.study.basin_figure import parts, sentence, summary

    data = sets_of(("fish",), recordings, asked)["fish"]
    wanted = study.planned(asked.seeds, asked.epochs, quick=asked.quick)
    train_with_bar([(data, run) for run in wanted], asked.runs)
    echo = study.echo_of(data)
    with progress("Looking where delays ended", 1):
        ends = study.ended(data, wanted, asked.runs)
    result = {
        "quick": asked.quick,
        "seeds": asked.seeds,
        "true_s": echo.true_s,
        "alias_s": echo.alias_s,
        "ends": [dataclasses.asdict(end) | {"at": study.where(end, echo)} for end in ends],
    }
    title = asked.titled("Where Delay Embedding ends, by where it starts")
    path = write_page(asked.results("basin"), title, lambda: parts(ends, echo), result, [data])
    print_table(sentence(ends, echo), *summary(ends, echo))
    click.echo(f"Figures, tables and the page: {path}")


@click.command("fish-scatter")
@recordings_option("fish")
@study_options
def fish_scatter(recordings: Path | None, asked: Asked) -> None:
    """Draw true against predicted displacements of the flag, without memory and with the best one.

    The best memory is the one that did best on the validation block.

    \b
    Example:
        wakedeploy study fish-scatter --recordings ../data --seeds 3 --out study
        wakedeploy study fish-scatter --recordings ../data --quick
    """
    from trainers.build import ARCHITECTURES
    from wakedeploy.study import fish_scatter as study
    from wakedeploy.study.domains import compare, planned
    from wakedeploy.study.fish_scatter_figure import parts, sentence, summary

    data = sets_of(("fish",), recordings, asked)["fish"]
    jobs = [(data, run) for run in planned(data, [*ARCHITECTURES], asked.seeds, asked.epochs)]
    train_with_bar(jobs, asked.runs)
    common = (asked.seeds, asked.runs)
    with progress("Scoring", 1):
        lines = compare(data, [*ARCHITECTURES], *common, epochs=asked.epochs)
        shown = study.shown(data, lines, asked.runs)
    result = {
        "quick": asked.quick,
        "seeds": asked.seeds,
        "best": shown[1].arch,
        "lines": [line.as_json() for line in lines],
    }
    title = asked.titled("The fish's flag, true and predicted")
    folder = asked.results("fish-scatter")
    path = write_page(folder, title, lambda: parts(lines, shown, data.rate_hz), result, [data])
    print_table(sentence(shown), *summary(lines))
    click.echo(f"Figures, tables and the page: {path}")


def _made(case: "Case", asked: Asked) -> "EpisodeSet":
    """A case's set, made on the first call."""
    from wakedeploy.study.sets import obtain

    with progress(f"{case.domain.name}: episodes", 1) as bar:
        made = obtain(case.domain, asked.out / "sets", None, quick=asked.quick, progress=bar.update)
    assert made is not None  # it has a `make`
    return made
