"""The part of `wakedeploy export` that writes C."""

import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import click

from wakedeploy.cli.numbers import Within
from wakedeploy.cli.output import print_table, progress
from wakedeploy.core.errors import UnusableInput

if TYPE_CHECKING:
    from export.c.packaging import Wish
    from runtime.compiled.folder import CFolder
    from trainers.trained_run import TrainedRun
    from wakedeploy.core.episodes import EpisodeSet
    from wakedeploy.core.package import Package

_WEIGHTS = ("float32", "float16", "int8")
_TOLERANCE = 2.0  # per cent


def c_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Options for a folder of C."""
    options = [
        click.option(
            "--c",
            "c_folder",
            type=click.Path(path_type=Path),
            metavar="FOLDER",
            help="Also write it as C into this new folder.",
        ),
        click.option(
            "--package",
            "c_package",
            type=click.Path(dir_okay=False, path_type=Path),
            metavar="FILE",
            help="With --c: from this package instead of a run.",
        ),
        click.option(
            "--weights",
            "c_weights",
            type=click.Choice(_WEIGHTS),
            default=_WEIGHTS[0],
            show_default=True,
            help="How C keeps the weights of matrices.",
        ),
        click.option(
            "--name",
            "c_name",
            metavar="NAME",
            help="What C calls it: NAME_step and so on. Default: the architecture.",
        ),
        click.option(
            "--tolerance",
            "c_tolerance",
            type=Within(0.0, 100.0),
            default=_TOLERANCE,
            show_default=True,
            help="Per cent by which rounded weights may make the error grow.",
        ),
        click.option(
            "--cflags",
            "c_flags",
            metavar="FLAGS",
            default="",
            help="Prove it with these flags of the compiler, too.",
        ),
    ]
    for option in reversed(options):
        command = option(command)
    return command


@dataclass(frozen=True)
class CWish:
    """What the options ask for."""

    folder: Path | None
    package: Path | None
    weights: str
    name: str | None
    tolerance: float
    flags: tuple[str, ...]

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> Self:
        """Judged before anything is read; UnusableInput for options without --c."""
        folder, given = options["c_folder"], click.get_current_context().get_parameter_source
        if folder is None:
            for name, option in (
                ("c_package", "--package"),
                ("c_weights", "--weights"),
                ("c_name", "--name"),
                ("c_tolerance", "--tolerance"),
                ("c_flags", "--cflags"),
            ):
                source = given(name)
                if source is not None and source.name != "DEFAULT":
                    raise UnusableInput(f"{option} belongs to --c FOLDER, which is not given.")
        wish = cls(
            folder,
            options["c_package"],
            options["c_weights"],
            options["c_name"],
            options["c_tolerance"],
            _flags(options["c_flags"]),
        )
        if folder is not None:
            wish.for_export()  # raises before minutes are spent
        return wish

    def for_export(self) -> "Wish":
        """This wish as the exporter takes it. Raises now for whatever is already known to fail."""
        from wakedeploy.api.compiled import AsC, wish_of

        assert self.folder is not None
        weights: Any = self.weights
        asked = AsC(
            weights=weights, name=self.name, tolerance=self.tolerance / 100.0, flags=self.flags
        )
        return wish_of(self.folder, asked)


def _flags(text: str) -> tuple[str, ...]:
    try:
        return tuple(shlex.split(text))
    except ValueError as error:
        raise UnusableInput(f"--cflags {text!r}: a quotation mark has no partner.") from error


def c_of_package(wish: CWish, data: Path | None) -> dict[str, Any]:
    """Write C from a package's file; the result for --json."""
    from wakedeploy.api import compiled
    from wakedeploy.core.episodes import read_episode_set
    from wakedeploy.core.package import read_package

    if wish.folder is None or wish.package is None:
        raise UnusableInput("--package belongs to --c FOLDER, which is not given.")
    package = read_package(wish.package)
    episodes = None if data is None else read_episode_set(data)
    with progress("Writing C", 1) as bar:
        written = compiled.c_of_package(
            package, wish.folder, wish.for_export(), episodes, bar.update
        )
    return _report(written)


def c_of_run(
    wish: CWish, package: "Package", run: "TrainedRun", data: "EpisodeSet"
) -> dict[str, Any]:
    """Write C from a run that has just become a package; the result for --json."""
    from wakedeploy.api import compiled

    assert wish.folder is not None
    with progress("Writing C", 1) as bar:
        written = compiled.c_of_run(package, run, wish.folder, wish.for_export(), data, bar.update)
    return _report(written)


def _report(folder: "CFolder") -> dict[str, Any]:
    _tell(folder)
    return json_of_c(folder)


def json_of_c(folder: "CFolder") -> dict[str, Any]:
    """What --json says of a folder of C."""
    document = folder.document
    content = document.model_dump(mode="json", exclude={"manifest", "schema_version"})
    return content | {"folder": str(folder.path), "arch": document.manifest.arch}


def _tell(folder: "CFolder") -> None:
    document = folder.document
    rows = [
        ["weights", f"{document.weights}, {document.weight_bytes / 1e3:.0f} kB of flash"],
        ["state, stack", f"{document.state_bytes:,} and {document.stack_bytes:,} bytes"],
        *(
            [f"parity, {proof.flags}", f"{proof.max_rel:.1e} of {document.limit:.1e}"]
            for proof in document.proofs
        ),
        *rounding_rows(folder),
    ]
    print_table(f"{folder.path} ({document.name}.c)", ["", ""], rows)


def rounding_rows(folder: "CFolder") -> list[list[str]]:
    """What rounded weights change, as lines of a table."""
    rounding = folder.document.rounding
    if rounding is None:
        return []
    rows = [["rounding changes the force", f"{rounding.rel_rms:.2%} of its deviation (RMS)"]]
    if rounding.rmse is not None and rounding.float_rmse is not None:
        rows += [
            [f"RMSE of {name}", f"{error:.4g} where it was {rounding.float_rmse[name]:.4g}"]
            for name, error in rounding.rmse.items()
        ]
    return [*rows, ["measured on", rounding.on]]
