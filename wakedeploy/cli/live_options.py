"""What every command that serves a page asks for, and what it says."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

TOKEN = click.option(
    "--live-token",
    type=click.Path(dir_okay=False, path_type=Path),
    help="Keep the page's token in this file; needed where other computers reach the page.",
)
_DEFAULT = "127.0.0.1:8032"
_FOXGLOVE = "127.0.0.1:8765"  # where Foxglove looks first


def address_option(name: str) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """The option that says where a page is served, of a command that always serves one."""
    return click.option(
        name,
        metavar="HOST:PORT",
        default=_DEFAULT,
        show_default=True,
        help="Serve the page there; a path is a socket for ssh -L.",
    )


def live_option() -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """The option of a command that serves a page only when asked."""
    return click.option(
        "--live",
        metavar="[HOST:PORT]",
        is_flag=False,
        flag_value=_DEFAULT,
        help="Show the flight in a browser as it is flown, in real time; a path is a socket for "
        f"ssh -L. Default: {_DEFAULT}.",
    )


def foxglove_option() -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """The option of a command that serves a flight to Foxglove when asked."""
    return click.option(
        "--foxglove",
        metavar="[HOST:PORT]",
        is_flag=False,
        flag_value=_FOXGLOVE,
        help=f"Serve the flight to Foxglove as it is flown, in real time. Default: {_FOXGLOVE}.",
    )


def tell_address(url: str) -> None:
    """Say what to open; the token in it is all that anybody needs."""
    click.echo(f"Live page: {url}", err=True)


def tell_foxglove(url: str) -> None:
    """Say what to connect Foxglove to, and how its panels are arranged."""
    from wakedeploy.live.foxglove_layout import LAYOUT

    click.echo(f"Foxglove: Open connection, {url}; import the layout {LAYOUT}", err=True)
