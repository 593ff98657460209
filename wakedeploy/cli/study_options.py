"""What all studies ask for: which models, how many seeds, where the recordings are."""

import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.names import SOME_DOMAINS, OptionOfNames
from wakedeploy.cli.output import progress
from wakedeploy.cli.recordings import VARIABLE, recordings_folder
from wakedeploy.core import names as known
from wakedeploy.core.commit import present_commit
from wakedeploy.core.errors import UnusableInput

if TYPE_CHECKING:
    from wakedeploy.core.episodes import EpisodeSet
    from wakedeploy.study.folder import Part
    from wakedeploy.study.runs import Wanted

_QUICK_EPOCHS = 4
Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


@dataclass(frozen=True)
class Asked:
    """The options that every study has, and the folders that follow from them."""

    seeds: int
    out: Path
    quick: bool

    @property
    def runs(self) -> Path:
        """Where runs lie: those of a quick look apart from the others."""
        return self.out / ("runs-quick" if self.quick else "runs")

    @property
    def epochs(self) -> int | None:
        """How long to train, None for as usual."""
        return _QUICK_EPOCHS if self.quick else None

    def results(self, study: str, domains: Sequence[str] = ()) -> Path:
        """Where a study's results lie: those of a quick look or of chosen domains apart."""
        chosen = [] if set(domains) == set(known.domains()) else domains
        return self.out / "-".join([study, *chosen, *["quick"] * self.quick])

    def titled(self, title: str) -> str:
        """The title, which says so if this is only a quick look."""
        return title + (" (a quick look)" if self.quick else "")


def study_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command `--seeds`, `--out` and `--quick` as one argument `asked`."""

    def with_asked(*, seeds: int, out: Path, quick: bool, **others: Any) -> Any:
        import torch

        present_commit()  # now, and not hours later when the results are written
        torch.set_num_threads(1)  # small models are slower on several
        return function(asked=Asked(1 if quick else seeds, out, quick), **others)

    with_asked.__doc__ = function.__doc__
    with_asked.__name__ = function.__name__
    folder = click.Path(file_okay=False, path_type=Path)
    for option in (
        click.option("--quick", is_flag=True, help="Little data, one seed, few epochs."),
        click.option(
            "--out",
            type=folder,
            default="study",
            show_default=True,
            help="Folder for sets, runs and results; what is there is used.",
        ),
        click.option(
            "--seeds",
            type=click.IntRange(1, 100),
            default=3,
            show_default=True,
            help="Training seeds; 1 with --quick.",
        ),
    ):
        with_asked = option(with_asked)
    return with_asked


def recordings_option(*names: str) -> Decorator:
    """`--recordings`, a folder that has these in it."""
    return click.option(
        "--recordings",
        type=click.Path(file_okay=False, path_type=Path),
        help=f"Folder with {', '.join(names)} in it. Default: ${VARIABLE}.",
    )


domains_option: Decorator = click.option(
    "--domains",
    "names",
    cls=OptionOfNames,
    names=known.domains,
    type=SOME_DOMAINS,
    metavar="all|NAME[,NAME…]",
    default="all",
    show_default=True,
    help="Of {names}.",
)


def sets_of(names: Sequence[str], recordings: Path | None, asked: Asked) -> "dict[str, EpisodeSet]":
    """The chosen domains' sets, as far as their recordings are there; says what is left out."""
    from wakedeploy.study.sets import DOMAINS, obtain

    domains = [DOMAINS[name] for name in names]
    if any(domain.recordings for domain in domains):
        recordings = recordings_folder(recordings)
    sets = {}
    for domain in domains:
        with progress(f"{domain.name}: episodes", 1) as bar:
            made = obtain(
                domain, asked.out / "sets", recordings, quick=asked.quick, progress=bar.update
            )
        if made is None:
            click.echo(f"{domain.name}: left out, its recordings are not there (--recordings).")
        else:
            sets[domain.name] = made
    if not sets:
        missing = ", ".join(domain.recordings for domain in domains)
        raise UnusableInput(f"No recordings are there: give --recordings a folder with {missing}.")
    return sets


def train_with_bar(jobs: "Sequence[tuple[EpisodeSet, Wanted]]", runs: Path) -> None:
    """Train what is not there yet, and show how long is left.

    Runs count as what each roughly costs: ten reservoirs say little of ten recurrent networks.
    """
    from wakedeploy.study.runs import train_all, untrained, work

    left = untrained(jobs, runs)
    if left:
        with progress("Training", sum(work(*job) for job in left)) as bar:
            train_all(left, runs, on_run=bar.advance)


def write_page(
    folder: Path,
    title: str,
    parts: "Callable[[], Sequence[Part]]",
    result: Mapping[str, Any],
    sets: "Sequence[EpisodeSet]",
) -> Path:
    """Draw the parts and write the study; the page's path."""
    from wakedeploy.study.folder import write_study

    with progress("Drawing", 1):
        return write_study(folder, title, parts(), result, sets, next_commands=_commands())


def _commands() -> list[str]:
    """This command again, and of a quick look the whole study; then what lies in its folder."""
    context = click.get_current_context(silent=True)
    if context is None:
        return []
    asked = [option for option in context.command.params if _was_given(context, option)]
    whole = [_as_given(context, option) for option in asked if option.name != "quick"]
    again = [context.command_path, *whole]
    out = shlex.quote(str(context.params.get("out", "study")))
    return [" ".join(again), f"wakedeploy log browse {out}"]


def _was_given(context: click.Context, option: click.Parameter) -> bool:
    source = context.get_parameter_source(str(option.name))
    return source is click.core.ParameterSource.COMMANDLINE


def _as_given(context: click.Context, option: click.Parameter) -> str:
    value = context.params[str(option.name)]
    if value is True:
        return option.opts[-1]
    several = ",".join(map(str, value)) if isinstance(value, tuple | list) else str(value)
    return f"{option.opts[-1]} {shlex.quote(several)}"
