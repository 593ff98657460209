"""What all `calibrate` commands share: where to measure, and what becomes of the result."""

import contextlib
import datetime
import functools
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.output import print_table, write_json
from wakedeploy.errors import UnusableInput

if TYPE_CHECKING:
    from runtime.calibration import Outcome
    from runtime.calibration.session import Site
    from wakedeploy.rig import Rig
    from wakedeploy.runlog import RunLog

FILE = click.Path(dir_okay=False, path_type=Path)
# Effects that replace a constant: while the file lists one, its value holds whatever is calibrated.
_REPLACED_BY = {
    "range-bias": "range_sensor.bias_m",
    "range-scale": "range_sensor.scale",
    "spool-lag-sufferer": "spool.sufferer.up_s",
    "thrust-coefficient": "thrust.sufferer.thrust_n",
    "thrust-exponent": "thrust.sufferer.thrust_n",
}


@dataclass(frozen=True)
class Request:
    """One calibration: the rig file, where to measure, or the logs measured earlier."""

    rig_path: Path
    port: str | None
    virtual: bool
    plant_rig: Path | None
    range_socket: Path | None
    logs: tuple[Path, ...]
    keep_logs: Path | None
    json_path: Path | None

    @property
    def by_hand(self) -> bool:
        """Whether someone stands at the rig."""
        return self.port is not None

    def rig(self, *constants: str) -> "Rig":
        """The rig file, of which `constants` are to be measured.

        UnusableInput for options that contradict each other, and for an effect of the file that
        replaces one of the constants.
        """
        chosen = (self.port is not None) + self.virtual + bool(self.logs)
        if chosen != 1:
            raise UnusableInput("Say where to measure: one of --port PORT, --virtual, --log FILE.")
        if self.plant_rig and not self.virtual:
            raise UnusableInput("--plant-rig belongs to --virtual; a real rig is as it is.")
        if self.range_socket and self.port is None:
            raise UnusableInput("--range-socket belongs to --port; --virtual has one of its own.")
        if self.keep_logs and self.logs:
            raise UnusableInput("--keep-logs belongs to a new measurement; --log has its own file.")
        from wakedeploy.rig import read_rig

        rig = read_rig(self.rig_path)
        for entry in rig.effect:
            name = _REPLACED_BY.get(entry.name)
            if name in constants:
                raise UnusableInput(
                    f"{self.rig_path} lists the effect {entry.name}, which replaces {name}: remove "
                    "the entry, then calibrate."
                )
        return rig

    def true_rig(self, rig: "Rig") -> "Rig":
        """What the virtual gantry is in truth."""
        from wakedeploy.rig import read_rig

        return read_rig(self.plant_rig) if self.plant_rig else rig

    @contextlib.contextmanager
    def site(self, rig: "Rig") -> Iterator["Site"]:
        """Where to fly; the logs go to --keep-logs, or to a folder that is removed."""
        from runtime.calibration.session import Site

        with contextlib.ExitStack() as stack:
            if self.keep_logs is not None:
                self.keep_logs.mkdir(parents=True, exist_ok=True)
                folder = self.keep_logs
            else:
                folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            truth = self.true_rig(rig) if self.virtual else None
            show = _show if sys.stderr.isatty() else None
            yield Site(folder, self.port, self.range_socket, truth, show=show)

    def read_logs(self, count: int) -> "list[RunLog]":
        """The logs recorded earlier; UnusableInput unless there are `count` of them."""
        from wakedeploy.runlog import read_run_log

        if len(self.logs) != count:
            raise UnusableInput(
                f"{count} log{'s are' if count > 1 else ' is'} needed, in the order of the other "
                f"values, and {len(self.logs)} given."
            )
        return [read_run_log(path) for path in self.logs]

    def ask(self, what: str) -> None:
        """Tell the operator what to do and wait until it is done; nobody stands at a virtual rig.

        Without a terminal to answer at, Enter cannot be pressed and the command is aborted.
        """
        if self.by_hand:
            click.echo(what, err=True)
            click.prompt("Press Enter when it is done", default="", show_default=False, err=True)

    def finish(self, rig: "Rig", outcome: "Outcome") -> None:
        """Write the constants, then tell what they were and are."""
        from wakedeploy.rig_update import update_rig

        date = datetime.datetime.now(datetime.UTC).date().isoformat()
        after, kept = update_rig(self.rig_path, outcome.constants, date)
        rows = [
            [name, _shown(rig, name), _shown(after, name), f"± {known.spread:.2g} {known.unit}"]
            for name, known in outcome.constants.items()
        ]
        print_table(f"{self.rig_path}", ["constant", "before", "now", "spread"], rows)
        for sentence in outcome.told:
            click.echo(sentence)
        if not kept:
            click.echo(f"{self.rig_path} had to be written anew; its comments are lost.")
        if self.keep_logs is not None:
            click.echo(f"Recorded in {self.keep_logs}.")
        if self.json_path:
            constants = {
                name: {
                    "before": _value(rig, name),
                    "value": _value(after, name),
                    "spread": known.spread,
                    "unit": known.unit,
                    "date": date,
                }
                for name, known in outcome.constants.items()
            }
            write_json(self.json_path, {"constants": constants, "told": list(outcome.told)})


def shared_options(command: Callable[..., None]) -> Callable[..., None]:
    """Adds the options of all `calibrate` commands, handed on as a `Request`."""

    @functools.wraps(command)
    def with_request(
        rig_path: Path,
        port: str | None,
        virtual: bool,
        plant_rig: Path | None,
        range_socket: Path | None,
        log_paths: tuple[Path, ...],
        keep_logs: Path | None,
        json_path: Path | None,
        **own: Any,
    ) -> None:
        command(
            Request(
                rig_path, port, virtual, plant_rig, range_socket, log_paths, keep_logs, json_path
            ),
            **own,
        )

    folder = click.Path(file_okay=False, path_type=Path)
    for option in reversed(
        (
            click.option("--rig", "rig_path", type=FILE, required=True, help="Updated in place."),
            click.option("--port", help="Serial port of the UNO, such as /dev/ttyACM0."),
            click.option("--virtual", is_flag=True, help="On the virtual gantry."),
            click.option("--plant-rig", type=FILE, help="What the virtual gantry is in truth."),
            click.option("--range-socket", type=FILE, help="With --port: samples from here."),
            click.option("--log", "log_paths", type=FILE, multiple=True,
                         help="From a log recorded earlier."),
            click.option("--keep-logs", type=folder, help="Record what is flown in this folder."),
            click.option("--json", "json_path", type=FILE, help="Also write the result as JSON."),
        )
    ):  # fmt: skip
        with_request = option(with_request)
    return with_request


def _value(rig: "Rig", name: str) -> Any:
    return functools.reduce(getattr, name.split("."), rig)


def _shown(rig: "Rig", name: str) -> str:
    value = _value(rig, name)
    if isinstance(value, tuple):
        return f"{value[0]:g} … {value[-1]:.4g}"
    return f"{value:.6g}"


def _show(done_s: float, total_s: float) -> None:
    sys.stderr.write(f"\rMeasuring: {done_s:.0f} of {total_s:.0f} s\x1b[K")
    if done_s >= total_s - 0.5:
        sys.stderr.write("\r\x1b[K")
    sys.stderr.flush()
