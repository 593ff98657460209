"""`wakedeploy live`: a recorded flight on the page that shows flying ones."""

from pathlib import Path

import click

from wakedeploy.cli.live_options import TOKEN, address_option, tell_address
from wakedeploy.cli.output import stage_bars


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@address_option("--listen")
@TOKEN
def command(file: Path, listen: str, live_token: Path | None) -> None:
    """Replay a recorded flight in the browser: at its own pace, faster, slower, from anywhere.

    It is the page that `run-gantry --live` shows, without STOP. Space pauses, the arrow keys go
    back and on. Ctrl-C ends it.

    \b
    Example:
        wakedeploy live flight.mcap
    """
    from wakedeploy.core.runlog import read_run_log, require_run_log
    from wakedeploy.live.process import require_tornado

    require_tornado()
    require_run_log(file)
    from wakedeploy.live.replay import Replay, replay

    def read() -> Replay:
        with stage_bars() as bars:
            bars("Reading the log")
            log = read_run_log(file)
            return Replay(log, file.name, lambda *steps: bars("Smoothing the force", *steps))

    replay(read, listen, live_token, tell_address)
