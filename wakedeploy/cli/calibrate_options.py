"""What all `calibrate` commands share: where to measure, and what becomes of the result."""

import contextlib
import datetime
import functools
import itertools
import tempfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from wakedeploy.cli.flight_options import (
    FILE,
    Command,
    end_progress,
    place_options,
    require_place,
    shown_progress,
    warn,
    with_options,
)
from wakedeploy.cli.output import Written, answered_by_hand, print_table, write_json
from wakedeploy.core.errors import UnusableInput, WakedeployError

if TYPE_CHECKING:
    from runtime.calibration import Outcome
    from runtime.calibration.session import Site
    from runtime.loop.tally import Tally
    from wakedeploy.core.rig import Effect, Rig
    from wakedeploy.core.runlog import RunLog

_FOLDER = click.Path(file_okay=False, path_type=Path)
_RIG_FILES = (
    click.option("--rig", "rig_path", type=FILE, required=True,
                 help="Updated in place, unless --out is given."),
    click.option("--out", type=Written(may_replace=True),
                 help="Write this rig file; what is simulated needs it."),
)  # fmt: skip
_LOGS = (
    click.option("--log", "logs", type=FILE, multiple=True, help="From a log recorded earlier."),
    click.option("--keep-logs", type=_FOLDER, help="Record what is flown in this folder. "
                 "Default at a port: calibration/DATE-NAME beside the rig file."),
    click.option("--json", "json_path", type=Written(), help="Also write the result as JSON."),
)  # fmt: skip


def _replaced_by(entry: "Effect") -> set[str]:
    """The places of the rig file whose constants an effect replaces."""
    from wakedeploy.physics.constants import place_of
    from wakedeploy.physics.effects.chain import effect_of

    return {place_of(p.constant) for p in effect_of(entry).parameters if p.constant}


@dataclass(frozen=True)
class Request:
    """One calibration: the rig file, where to measure, or the logs measured earlier."""

    rig_path: Path
    out: Path
    port: str | None
    virtual: bool
    plant_rig: Path | None
    range_socket: Path | None
    firmware: bool
    wall_clock: bool
    realtime: bool | None
    logs: tuple[Path, ...]
    keep_logs: Path | None
    json_path: Path | None
    recorded: list[Path] = field(default_factory=list, init=False)

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
        require_place(
            port=self.port,
            virtual=self.virtual,
            firmware=self.firmware,
            wall_clock=self.wall_clock,
            realtime=self.realtime,
            plant_rig=self.plant_rig,
            range_socket=self.range_socket,
        )
        if self.logs and (self.realtime is not None or self.wall_clock):
            given = "--wall-clock" if self.wall_clock else "--realtime"
            raise UnusableInput(f"{given} belongs to a new measurement; --log has been flown.")
        if self.keep_logs and self.logs:
            raise UnusableInput("--keep-logs belongs to a new measurement; --log has its own file.")
        if self.virtual:
            self._require_another_file("The virtual gantry")
        from wakedeploy.rig.file import read_rig

        rig = read_rig(self.rig_path)
        # While the file lists an effect that replaces a constant, its value holds, not this one.
        for entry in rig.effect:
            for name in _replaced_by(entry) & set(constants):
                raise UnusableInput(
                    f"{self.rig_path} lists the effect {entry.name}, which replaces {name}: remove "
                    "the entry, then calibrate."
                )
        return rig

    def true_rig(self, rig: "Rig") -> "Rig":
        """What the virtual gantry is in truth."""
        from wakedeploy.rig.file import read_rig

        return read_rig(self.plant_rig) if self.plant_rig else rig

    @contextlib.contextmanager
    def site(self, rig: "Rig") -> Iterator["Site"]:
        """Where to fly; the logs are kept at a port or as asked for, else they are removed."""
        from runtime.calibration.session import Site

        with contextlib.ExitStack() as stack:
            if self.keep_logs is not None:
                folder = self.keep_logs
                if not folder.exists():
                    folder.mkdir(parents=True)
                    stack.callback(_remove_if_empty, folder)
            else:
                folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            truth = self.true_rig(rig) if self.virtual else None
            yield Site(
                folder,
                self.port,
                self.range_socket,
                truth,
                firmware=self.firmware,
                wall_clock=self.wall_clock,
                realtime=self.realtime,
                tell=self._tell,
                show=shown_progress(),
                warn=warn,
            )

    def _tell(self, tally: "Tally") -> None:
        """After each run, before any error: the bar goes, its log is remembered if it stays."""
        end_progress()
        if self.keep_logs is not None and tally.log is not None:
            self.recorded.append(tally.log)

    def measured(
        self, rig: "Rig", record: "Callable[..., RunLog]", runs: Sequence[tuple[Any, ...]]
    ) -> "list[RunLog]":
        """The logs recorded earlier, or one from each run now.

        A run is what the operator reads before it ("" for nothing) and what `record` takes after
        site and rig.
        """
        if self.logs:
            return self.read_logs(len(runs))
        logs = []
        with self.site(rig) as site:
            for number, (question, *values) in enumerate(runs, 1):
                if question:
                    self.ask(question)
                which = f", {number} of {len(runs)}" if len(runs) > 1 else ""
                click.echo(f"… measuring{which}", err=True)
                logs.append(record(site, rig, *values))
        click.echo("… working out the constants", err=True)
        return logs

    def read_logs(self, count: int) -> "list[RunLog]":
        """The logs recorded earlier; UnusableInput unless there are `count` of them."""
        from wakedeploy.core.runlog import read_run_log

        if len(self.logs) != count:
            raise UnusableInput(
                f"{count} log{'s are' if count > 1 else ' is'} needed, in the order of the other "
                f"values, and {len(self.logs)} given."
            )
        logs = [read_run_log(path) for path in self.logs]
        for path, log in zip(self.logs, logs, strict=True):
            if log.metadata.get("simulated") == "true":
                self._require_another_file(f"{path}: a simulated run")
        return logs

    def _require_another_file(self, simulated: str) -> None:
        """UnusableInput where what is simulated would become the rig file's calibration."""
        if self.out.resolve() == self.rig_path.resolve():
            raise UnusableInput(
                f"{simulated} says nothing about the rig of {self.rig_path}; give --out FILE, "
                "another file than --rig, for what a rehearsal measures."
            )

    def ask(self, what: str) -> None:
        """Tell the operator what to do and wait until it is done; nobody stands at a virtual rig.

        UnusableInput where nobody can press Enter, as without a terminal.
        """
        if self.by_hand:
            click.echo(what, err=True)
            with answered_by_hand("give the command at a terminal, or a recording by --log"):
                done = "Press Enter when it is done"
                click.prompt(done, default="", show_default=False, err=True)

    def finish(self, rig: "Rig", outcome: "Outcome") -> None:
        """Write the constants, then print what they were and are."""
        from wakedeploy.rig.update import update_rig

        date = _today()
        after, kept = update_rig(self.rig_path, outcome.constants, date, self.out)
        rows = [
            [name, _shown(rig, name), _shown(after, name), f"± {known.spread:.2g} {known.unit}"]
            for name, known in outcome.constants.items()
        ]
        print_table(f"{self.out}", ["constant", "before", "now", "spread"], rows)
        for sentence in outcome.sentences:
            click.echo(sentence)
        if not kept:
            click.echo(f"{self.out} had to be written anew; its comments are lost.")
        if self.recorded:
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
            write_json(self.json_path, {"constants": constants, "told": list(outcome.sentences)})


def shared_options(command: Command) -> Command:
    """Adds the options of all `calibrate` commands, handed on as a `Request`."""

    @functools.wraps(command)
    def with_request(*, out: Path | None, keep_logs: Path | None, **values: Any) -> None:
        taken = {f.name: values.pop(f.name) for f in fields(Request) if f.name in values}
        if keep_logs is None and taken["port"] is not None:
            keep_logs = _log_folder(taken["rig_path"], str(click.get_current_context().info_name))
        request = Request(out=out or taken["rig_path"], keep_logs=keep_logs, **taken)
        try:
            command(request, **values)
        except WakedeployError as error:
            if not request.recorded:
                raise
            where = f"recorded in {request.recorded[-1]}."
            raise type(error)(f"{str(error).rstrip('.')}; {where}") from error
        except (KeyboardInterrupt, click.Abort):
            if request.recorded:
                click.echo(f"Recorded in {request.recorded[-1]}.", err=True)
            raise

    return with_options(_RIG_FILES, place_options(with_options(_LOGS, with_request)))


def _remove_if_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):
        folder.rmdir()


def _log_folder(rig_path: Path, procedure: str) -> Path:
    """A folder beside the rig file for this attempt: what was refused is what one wants to see."""
    wanted = rig_path.parent / "calibration" / f"{_today()}-{procedure}"
    later = (wanted.with_name(f"{wanted.name}-{number}") for number in itertools.count(2))
    return next(folder for folder in itertools.chain([wanted], later) if not folder.exists())


def _today() -> str:
    return datetime.datetime.now(datetime.UTC).date().isoformat()


def _value(rig: "Rig", name: str) -> Any:
    return functools.reduce(getattr, name.split("."), rig)


def _shown(rig: "Rig", name: str) -> str:
    value = _value(rig, name)
    if isinstance(value, tuple):
        return f"{value[0]:g} … {value[-1]:.4g}"
    return f"{value:.6g}"
