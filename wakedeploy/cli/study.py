"""`wakedeploy study`: the paper's comparisons, each one command."""

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.output import print_table, progress
from wakedeploy.errors import UnusableInput

if TYPE_CHECKING:
    from wakedeploy.episodes import EpisodeSet
    from wakedeploy.study.domains import Line

_QUICK_EPOCHS = 4


@click.group()
def command() -> None:
    """Repeat the paper's comparisons: tables, figures and a page for each.

    \b
    Example:
        wakedeploy study domains --recordings ../data --out study
        wakedeploy study domains --quick
    """


@command.command("domains")
@click.option("--domains", "names", default="all", show_default=True, help="all, or NAME[,NAME…].")
@click.option("--arch", default="all", show_default=True, help="all, or NAME[,NAME…].")
@click.option("--seeds", type=click.IntRange(1, 100), default=3, show_default=True)
@click.option(
    "--recordings",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder with quadrotor, fish and crazyflie in it. Default: $WAKEDEPLOY_DATA.",
)
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), default="study", show_default=True
)
@click.option("--quick", is_flag=True, help="Little data, one seed, few epochs: a first look.")
def domains(
    names: str, arch: str, seeds: int, recordings: Path | None, out: Path, quick: bool
) -> None:
    """Compare the architectures over the domains, on episodes never trained on.

    A stopped study goes on where it was. Domains whose recordings are not there are left out.

    \b
    Example:
        wakedeploy study domains --recordings ../data --seeds 3 --out study
        wakedeploy study domains --domains gantry,ship --arch agile-mlp,gru --quick
    """
    import torch

    from wakedeploy.cli.train import _architectures
    from wakedeploy.study.domains import compare, sentence
    from wakedeploy.study.domains_figure import parts, summary
    from wakedeploy.study.folder import write_study

    torch.set_num_threads(1)
    architectures, seeds = _architectures(arch), 1 if quick else seeds
    sets = _sets(names, recordings, out / "sets", quick)
    told: dict[str, list[Line]] = {}
    with progress("Training", len(sets) * len(architectures) * seeds) as bar:
        for name, made in sets.items():
            told[name] = compare(
                made,
                architectures,
                seeds,
                out / ("runs-quick" if quick else "runs"),
                epochs=_QUICK_EPOCHS if quick else None,
                on_run=bar.advance,
            )
    title = "Eight architectures over the domains" + (" (a quick look)" if quick else "")
    lines = [line.as_json() for own in told.values() for line in own]
    result = {"quick": quick, "seeds": seeds, "lines": lines}
    path = write_study(out / "domains", title, parts(told), result)
    for name, own in told.items():
        print_table(f"{name}: {sentence(name, own)}", *summary(own))
    click.echo(f"Figures, tables and the page: {path}")


def _sets(
    names: str, recordings: Path | None, folder: Path, quick: bool
) -> "dict[str, EpisodeSet]":
    """The chosen domains' sets, as far as their recordings are there."""
    from wakedeploy.study.sets import chosen, obtain

    if recordings is None and "WAKEDEPLOY_DATA" in os.environ:
        recordings = Path(os.environ["WAKEDEPLOY_DATA"])
    sets = {}
    for domain in chosen(names):
        with progress(f"{domain.name}: episodes", 1) as bar:
            made = obtain(domain, folder, recordings, quick=quick, progress=bar.update)
        if made is None:
            click.echo(f"{domain.name}: left out, its recordings are not there (--recordings).")
        else:
            sets[domain.name] = made
    if not sets:
        raise UnusableInput("No domain is left; give --recordings, or a simulated domain.")
    return sets


@command.command("closed-loop")
@click.option("--arch", default="all", show_default=True, help="all, or NAME[,NAME…].")
@click.option("--seeds", type=click.IntRange(1, 100), default=3, show_default=True)
@click.option("--flights", type=click.IntRange(2, 1000), default=16, show_default=True)
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), default="study", show_default=True
)
@click.option("--quick", is_flag=True, help="Little data, one seed, few epochs: a first look.")
def closed_loop(arch: str, seeds: int, flights: int, out: Path, quick: bool) -> None:
    """Fly the 2D simulator with no compensation, with the truth and with each architecture.

    Trains what `study domains` has not trained into the same folder yet.

    \b
    Example:
        wakedeploy study closed-loop --seeds 3 --out study
        wakedeploy study closed-loop --arch agile-mlp,gru --quick
    """
    import torch

    from trainers.training import configure, settings_for, train
    from wakedeploy.cli.train import _architectures
    from wakedeploy.study.closed_loop import sentence, track
    from wakedeploy.study.closed_loop_figure import parts, summary
    from wakedeploy.study.folder import write_study

    torch.set_num_threads(1)
    architectures, seeds = _architectures(arch), 1 if quick else seeds
    data = _sets("downwash", None, out / "sets", quick)["downwash"]
    runs, models = out / ("runs-quick" if quick else "runs"), []
    with progress("Training", len(architectures) * seeds) as bar:
        for name in architectures:
            settings = settings_for(name, epochs=_QUICK_EPOCHS if quick else None)
            trained = []
            for seed in range(seeds):
                config = configure(data, name, seed=seed, lead_s=0.0, settings=settings)
                trained.append(train(config, data, runs).predictor)
                bar.advance()
            models.append((name, trained))
    count, seconds = (4, 5.0) if quick else (flights, 20.0)
    with progress("Flying", 2 + len(architectures) * seeds) as bar:
        lines = track(models, count, seconds, on_flight=bar.advance)
    title = "Closed loop on the 2D downwash simulator" + (" (a quick look)" if quick else "")
    result: dict[str, Any] = {"quick": quick, "flights": count, "seconds": seconds}
    result |= {"rms_m": {line.name: line.rms_m.tolist() for line in lines}}
    path = write_study(out / "closed-loop", title, parts(lines), result)
    print_table(sentence(lines), *summary(lines))
    click.echo(f"Figures, tables and the page: {path}")
