"""`wakedeploy train`: fit one, several or all architectures on an episode set."""

import functools
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.names import PRESET
from wakedeploy.cli.output import (
    json_option,
    mean_and_spread,
    print_table,
    progress,
    what_differs,
    write_json,
)
from wakedeploy.cli.training_options import architectures_option, device_option, lead_option
from wakedeploy.core.errors import CheckFailed, UnusableInput
from wakedeploy.core.names import ARCHITECTURES, meant

if TYPE_CHECKING:
    from trainers.preset import Preset
    from trainers.trackers import Tracker
    from trainers.training.fit import FitSettings
    from trainers.training.runs import RunConfig, TrainedRun
    from trainers.training.score import Score
    from wakedeploy.core.episodes import EpisodeSet


@click.command()
@click.option("--data", type=click.Path(path_type=Path), required=True, help="An episode set.")
@architectures_option(None, otherwise="all, or the one of the --preset")
@click.option("--seeds", type=click.IntRange(1, 1000), default=1, show_default=True)
@lead_option
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), default="runs", show_default=True
)
@click.option("--epochs", type=click.IntRange(1, 100_000), help="Default: 60.")
@click.option(
    "--learning-rate", type=click.FloatRange(1e-7, 1), help="Peak. Default: 0.003, Mamba 0.01."
)
@click.option(
    "--hyper",
    "hyper",
    multiple=True,
    metavar="ARCH.NAME=VALUE",
    help="Change a hyper-parameter from its reference value; may be repeated.",
)
@click.option(
    "--preset",
    type=PRESET,
    default="reference",
    show_default=True,
    metavar="reference|tuned|FILE",
    help="The paper's shapes, those tuned for the set's domain, or what `tune` found.",
)
@click.option(
    "--threads",
    type=click.IntRange(1, 256),
    default=1,
    show_default=True,
    help="CPU threads; models this small rarely gain from a second, and lose on a busy machine.",
)
@device_option
@click.option("--fresh", is_flag=True, help="Replace runs that lie in --out already.")
@click.option(
    "--tracker",
    type=click.Choice(["tensorboard", "mlflow"], case_sensitive=False),
    help="Also tell it losses, learning rate, settings, scores and pictures. TensorBoard's events"
    " lie with the runs; MLflow's store is MLFLOW_TRACKING_URI, else mlflow.db in --out.",
)
@click.option("--no-pictures", is_flag=True, help="Numbers only.")
@json_option
def command(
    data: Path,
    arch: tuple[str, ...] | None,
    seeds: int,
    lead_s: float | None,
    out: Path,
    epochs: int | None,
    learning_rate: float | None,
    hyper: tuple[str, ...],
    preset: str,
    threads: int,
    device: str,
    fresh: bool,
    tracker: str | None,
    no_pictures: bool,
    json_path: Path | None,
) -> None:
    """Train predictors and print their errors on the test episodes.

    Goes on where it was stopped; a run that is finished with the same data and settings is not
    trained again. R² is pooled over the split; the spread over seeds follows ±. Each run's folder
    holds two pictures: curves.png, its errors over the epochs (of an esn, over the strengths of
    its ridge), and prediction.png, the liveliest test episode as it was and as predicted.

    \b
    Example:
        wakedeploy train --data sets/gantry --arch all --seeds 3 --lead 0.09 --json table.json
        wakedeploy train --data sets/fish --arch gru,delay-embedding \\
            --hyper delay-embedding.initial_delay_s=0.333
        wakedeploy train --data sets/gantry --preset tuned/gru/best.toml
    """
    import torch

    from trainers.training.score import unlearned
    from trainers.training.trainer import chosen_lead_s, configure
    from wakedeploy.core.episodes import read_episode_set

    names = arch or _archs_of(preset)
    overrides = _hyper(hyper, names)
    torch.set_num_threads(threads)
    episodes = read_episode_set(data)
    lead_s = chosen_lead_s(episodes, lead_s)
    presets = {name: _preset(preset, name, episodes, lead_s) for name in names}
    fits = {name: _settings(name, found, epochs, learning_rate) for name, found in presets.items()}
    shapes = {name: {**(p.hyper if p else {}), **overrides[name]} for name, p in presets.items()}
    configs = [
        configure(episodes, name, seed=seed, lead_s=lead_s, hyper=shapes[name], settings=fits[name])
        for name in names
        for seed in range(seeds)
    ]
    opened = _opened(tracker, out)
    runs = []
    for number, config in enumerate(configs, 1):
        what = f"Training {config.arch} s{config.seed} ({number} of {len(configs)})"
        with progress(what, int(config.settings["epochs"])) as bar:
            asked = {"on_epoch": bar.update, "fresh": fresh, "device": device}
            runs.append(_trained(config, episodes, out, not no_pictures, opened, asked))
    nothing_learned = unlearned(episodes, "test", lead_s)
    title = f"{data}: test episodes, force {lead_s:g} s ahead; runs in {out}"
    rows = [_row(run) for run in runs]
    print_scores(title, rows, runs[0].config, nothing_learned)
    if not no_pictures:
        where = runs[0].folder if len(runs) == 1 else "the folder of each run"
        click.echo(f"Pictures: curves.png and prediction.png in {where}.")
    if json_path:
        how = {"preset": preset, "lead_s": lead_s, "data_sha256": runs[0].config.data_sha256}
        lines = {"rows": rows, "unlearned": unlearned_rows(nothing_learned, lead_s)}
        write_json(json_path, how | lines)


def _trained(
    config: "RunConfig",
    episodes: "EpisodeSet",
    out: Path,
    pictures: bool,
    tracker: "Tracker | None",
    asked: Mapping[str, Any],
) -> "TrainedRun":
    """Train one run and draw it; of one that was interrupted or diverged, what there is."""
    from trainers.inspection.pictures import write_pictures, write_pictures_so_far
    from trainers.trackers import following
    from trainers.training.runs import run_folder
    from trainers.training.trainer import train

    folder, warn = run_folder(out, config), functools.partial(click.echo, err=True)
    with following(tracker, config, folder, fresh=asked["fresh"], warn=warn) as told:
        try:
            run = train(config, episodes, out, on_standing=told.stands, **asked)
        except (KeyboardInterrupt, CheckFailed):
            if pictures:
                _drawn(lambda: write_pictures_so_far(folder, episodes))
            raise
        told.finished(run, _drawn(lambda: write_pictures(run, episodes)) if pictures else [])
    return run


def _drawn(write: Callable[[], list[Path]]) -> list[Path]:
    """What was drawn; a picture that cannot be written costs no result."""
    try:
        return write()
    except UnusableInput as error:
        click.echo(f"No pictures: {error}", err=True)
        return []


def _opened(tracker: str | None, out: Path) -> "Tracker | None":
    """The tracker asked for; tells where it keeps what it is told."""
    from trainers.trackers import open_tracker

    if tracker is None:
        return None
    opened = open_tracker(tracker, out)
    click.echo(opened.told, err=True)
    return opened


def _settings(
    name: str, preset: "Preset | None", epochs: int | None, learning_rate: float | None
) -> "FitSettings":
    """How an architecture is fitted: as asked for, else by the preset, else as usual."""
    from trainers.training.trainer import settings_for

    others = preset.settings if preset is not None else None
    return settings_for(name, epochs=epochs, learning_rate=learning_rate, others=others)


def _preset(asked: str, arch: str, episodes: "EpisodeSet", lead_s: float) -> "Preset | None":
    """The preset asked for; tells where it was found for another lead or on another set.

    Two sets of a domain need not be alike: simulated and measured flights are both "gantry".
    """
    from trainers.preset import REFERENCE, chosen_preset

    found = chosen_preset(asked, arch, episodes.domain)
    if found is None:
        return None
    if found.study.get("ships") == REFERENCE:
        click.echo(
            f"The tuned preset of {arch} on {episodes.domain} sets is the paper's shape: what"
            f" {found.study.get('trials')} trials found was no better with other seeds.",
            err=True,
        )
        return found
    found_s = found.study.get("lead_s", lead_s)
    if found_s != lead_s:
        click.echo(
            f"The preset of {arch} was found for a lead of {found_s:g} s; this trains for"
            f" {lead_s:g} s (--lead {found_s:g} repeats it).",
            err=True,
        )
    if found.study.get("data_sha256") not in (None, episodes.sha256):
        click.echo(
            f"The preset of {arch} was found on another set ({found.study.get('data')}, "
            f"{found.study.get('trials')} trials, {found.study.get('date')}).",
            err=True,
        )
    return found


def _archs_of(preset: str) -> tuple[str, ...]:
    """The architecture of a preset's file; all of them where none is given."""
    from trainers.preset import REFERENCE, TUNED, read_preset

    return ARCHITECTURES if preset in (REFERENCE, TUNED) else (read_preset(Path(preset)).arch,)


def _hyper(asked: Iterable[str], names: Sequence[str]) -> dict[str, dict[str, Any]]:
    """The overrides by architecture; every architecture that is trained has an entry."""
    overrides: dict[str, dict[str, Any]] = {name: {} for name in names}
    for entry in asked:
        place, equals, text = entry.partition("=")
        given, dot, name = place.partition(".")
        arch = meant(given, names)
        if not equals or not dot or arch is None:
            raise UnusableInput(
                f"--hyper {entry}: write ARCH.NAME=VALUE for one of {', '.join(names)}."
            )
        try:
            overrides[arch][name] = json.loads(text)
        except json.JSONDecodeError as error:
            raise UnusableInput(f"--hyper {entry}: '{text}' is not a number.") from error
    return overrides


def _row(run: "TrainedRun") -> dict[str, Any]:
    """One line of the machine-readable table; `seconds` is the time that training took."""
    return score_row(
        run, "test", run.metrics.test.rmse, run.metrics.test.r2, seconds=run.metrics.seconds
    )


def score_row(
    run: "TrainedRun",
    split: str,
    rmse: dict[str, float],
    r2: dict[str, float | None],
    seconds: float,
) -> dict[str, Any]:
    """A run's errors on a split, as `train --json` and `evaluate --json` write them.

    `run` is its folder, `device` where it was trained.
    """
    return {
        "run": str(run.folder),
        "arch": run.config.arch,
        "seed": run.config.seed,
        "lead_s": run.config.lead_s,
        "hyper": run.config.hyper,
        "settings": run.config.settings,
        "kept_from": list(run.config.present_only),
        "data_sha256": run.config.data_sha256,
        "trainable": run.metrics.trainable,
        "frozen": run.metrics.frozen,
        "split": split,
        "rmse": rmse,
        "r2": r2,
        "seconds": round(seconds, 3),
        "device": run.metrics.device,
    }


def print_scores(
    title: str,
    rows: list[dict[str, Any]],
    config: "RunConfig",
    unlearned: Mapping[str, "Score"],
) -> None:
    """What has learned nothing, then each configuration, mean ± spread over its seeds."""
    columns = ["architecture", "trainable", "frozen"]
    ceiling = unlearned["zero"].ceiling
    for channel in config.force:
        limit = f" (ceiling {ceiling[channel.name]:.3f})" if ceiling else ""
        columns += [f"RMSE {channel.name} [{channel.unit}]", f"R² {channel.name}{limit}"]
    groups: dict[str, list[dict[str, Any]]] = {}
    for row in rows:
        groups.setdefault(json.dumps([row["arch"], _told_apart_by(row)]), []).append(row)
    table = [_unlearned_line(name, scored, config) for name, scored in unlearned.items()]
    for own in groups.values():
        alike = [_told_apart_by(row) for row in rows if row["arch"] == own[0]["arch"]]
        differs = what_differs(_told_apart_by(own[0]), alike)
        name = own[0]["arch"] + (f" ({differs})" if differs else "")
        line = [name, f"{own[0]['trainable']:,}", f"{own[0]['frozen']:,}"]
        for channel in config.force:
            line.append(mean_and_spread([row["rmse"][channel.name] for row in own], ".4g"))
            line.append(mean_and_spread([row["r2"][channel.name] for row in own], ".4f"))
        table.append([*line, mean_and_spread([row["seconds"] for row in own], ".1f")])
    print_table(title, [*columns, "seconds"], table)


def _unlearned_line(name: str, scored: "Score", config: "RunConfig") -> list[str]:
    line = [name, "", ""]
    for channel in config.force:
        line.append(mean_and_spread([scored.rmse[channel.name]], ".4g"))
        line.append(mean_and_spread([scored.r2[channel.name]], ".4f"))
    return [*line, ""]


def unlearned_rows(unlearned: Mapping[str, "Score"], lead_s: float) -> list[dict[str, Any]]:
    """The same for `--json`."""
    return [
        {"predictor": name, "lead_s": lead_s, "rmse": scored.rmse, "r2": scored.r2}
        for name, scored in unlearned.items()
    ]


def _told_apart_by(row: dict[str, Any]) -> dict[str, Any]:
    """Everything of a run's configuration that is not its seed."""
    kept = {"kept_from": row["kept_from"], "data": row["data_sha256"][:8]}
    return {"lead_s": row["lead_s"], **row["settings"], **row["hyper"], **kept}
