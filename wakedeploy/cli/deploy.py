"""`wakedeploy deploy`: a package onto the computer at the rig, and back to the one before."""

import re
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

import click

from wakedeploy.cli.output import progress
from wakedeploy.core.errors import UnusableInput

if TYPE_CHECKING:
    from wakedeploy.deploy.site import Links, Site

_FILE = click.Path(dir_okay=False, path_type=Path)
_DIRECTORY, _COMMAND = "wakedeploy", "wakedeploy"


@click.command()
@click.argument("target")
@click.argument("package", required=False, type=click.Path(path_type=Path))
@click.option("--rollback", is_flag=True, help="Make the previous package current again.")
@click.option("--directory", default=_DIRECTORY, show_default=True, help="The folder there.")
@click.option(
    "--command",
    "remote_command",
    default=_COMMAND,
    show_default=True,
    help="wakedeploy there, such as venv/bin/wakedeploy.",
)
@click.option("-F", "--ssh-config", type=_FILE, help="ssh's configuration file, as in ssh -F.")
def command(
    target: str,
    package: Path | None,
    rollback: bool,
    directory: str,
    remote_command: str,
    ssh_config: Path | None,
) -> None:
    """Copy PACKAGE to TARGET over ssh, check it there, and make it current.

    TARGET is what ssh takes: pi@host, a Host of your ssh configuration, or ssh://pi@host:2222; a
    key has to let you in without a question. Paths there start in the home folder. In the folder
    there current.onnx leads to the package and previous.onnx to the one before; packages stay in
    packages/, named by their hash. Where a rig.toml lies in the folder, the package has to be for
    that rig: its rate, channels and lead. When anything fails, current.onnx is what it was. A run
    that is flying keeps its package; the next one takes the new. A folder of C is copied by hand;
    the sentence that refuses it says how.

    \b
    Example:
        wakedeploy deploy pi@rig gru.onnx
        wakedeploy deploy pi@rig --rollback
    """
    if (package is None) != rollback:
        raise UnusableInput("Say what to do: either deploy a PACKAGE, or go back with --rollback.")
    if package is not None:
        _require_target_first(target, package)
    from wakedeploy.deploy.remote import Remote
    from wakedeploy.deploy.site import Site

    site = Site(Remote(target, ssh_config), directory, remote_command)
    if package is None:
        with progress(f"Going back on {target}", 1):
            links = site.roll_back()
        _tell(site, "Rolled back", links, "Forth again")
    elif package.is_dir():
        from runtime.compiled.folder import read_c_folder

        if not any(package.glob("*.c")):
            read_c_folder(package)  # which says how a run becomes a package, and what others lack
        raise UnusableInput(_by_hand(package, site))
    else:
        _deploy(site, package)


def _require_target_first(target: str, package: Path) -> None:
    """UnusableInput where a package stands first, and after it what ssh could take.

    A host may be called as a file is that lies here: then the package may only be mistyped.
    """
    is_package = Path(target).suffix == ".onnx" and Path(target).is_file()
    other = re.sub("^ssh:/(?!/)", "ssh://", str(package))  # of two slashes a path keeps one
    is_path = package.suffix == ".onnx" or ("/" in other and not other.startswith("ssh://"))
    if is_package and not is_path and not package.exists():
        swapped = shlex.join(["wakedeploy", "deploy", other, target])
        raise UnusableInput(f"{target}: is a file, and the target comes first: `{swapped}`.")


def _by_hand(folder: Path, site: "Site") -> str:
    """What to do with a folder of C instead, as a sentence with its two commands."""
    target, there = site.remote.target, site.directory.removeprefix("~/").rstrip("/")
    is_url = target.startswith("ssh://")
    place = f"scp{target.removeprefix('ssh')}/{there}/" if is_url else f"{target}:{there}/"
    check = shlex.join([site.command, "check", f"{there}/{folder.resolve().name}"])
    options = _ssh_options(site)
    return (
        f"{folder}: deploy takes a package's file, and this is a folder; copy a folder of C by"
        f" `{shlex.join(['scp', *options, '-r', str(folder), place])}`, then check it there by"
        f" `{shlex.join(['ssh', *options, target, check])}`."
    )


def _ssh_options(site: "Site") -> list[str]:
    return [] if site.remote.ssh_config is None else ["-F", str(site.remote.ssh_config)]


def _deploy(site: "Site", file: Path) -> None:
    from wakedeploy.core.package import read_package

    package = read_package(file)
    manifest = package.manifest
    what = f"{manifest.arch} for {manifest.domain}, {len(package.model_bytes) / 1000:.0f} kB"
    with progress(f"Copying to {site.remote.target}, and checking there", 1):
        links = site.deploy(package, file.name)
    _tell(site, f"Copied and checked there: {file.name} ({what})", links, "Back to it")


def _tell(site: "Site", done: str, links: "Links", way: str) -> None:
    click.echo(f"{done}.")
    current = f"{site.directory.rstrip('/')}/current.onnx"
    click.echo(f"{site.remote.target}: {current} is now {links.current}.")
    if links.previous is None or links.previous == links.current:
        click.echo("There is no other one before it.")
        return
    options = _ssh_options(site)
    for name, value, default in (
        ("--directory", site.directory, _DIRECTORY),
        ("--command", site.command, _COMMAND),
    ):
        options += [] if value == default else [name, value]
    again = shlex.join(["wakedeploy", "deploy", site.remote.target, "--rollback", *options])
    click.echo(f"Before it was {links.previous}. {way}: {again}")
