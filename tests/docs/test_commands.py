"""Every command of README.md and docs/: it runs, small and in its page's order, or it is read.

What is only read stands with the reason in `shell_lines`; everything else runs here, the slow ones
by `pytest -m slow`.
"""

import glob
import importlib
import os
import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner
from shell_lines import ALL, NOT_RUN, OTHERS, PAGES, ROOT, Line, fences, files, lines

from wakedeploy.cli import main
from wakedeploy.cli.doctor import CALIBRATIONS
from wakedeploy.rig.file import default_rig_text, read_rig

READ = [line for line in ALL if line.not_run_because]
RUN = [line for line in ALL if line.is_ours and not line.not_run_because]
MISSING = """
[[effect]]
name = "ground-effect"
parameters = { gain = { value = 0.3, unit = "1" }, height_m = { value = 0.2, unit = "m" } }
"""  # what the flights of gap.md have and its rig file lacks
IN_ORDER = "docs/tutorials/first-predictor.md"  # makes what the other pages begin with


def test_every_line_is_run_or_read_and_every_reason_is_needed() -> None:
    left = [str(line) for line in ALL if line not in READ and line not in RUN]
    assert left == []
    used = {line.not_run_because for line in READ}
    assert used == {*NOT_RUN.values(), *OTHERS.values()}
    assert len(RUN) > 40


def test_every_block_says_what_it_is() -> None:
    words = {word for page in PAGES for word, *_ in fences(page)}
    assert words <= {"sh", "toml", "ini", "xml", "python", "text", "{made}", "{eval-rst}"}


def of(page: Path, *beginnings: str) -> list[Line]:
    """A page's lines that begin so."""
    return [line for line in lines(page) if line.text.startswith(beginnings)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_our_commands_have_these_options(page: Path) -> None:
    for line in of(page, "wakedeploy "):
        command, context, words = resolved(shlex.split(line.text)[1:])
        values, left, _ = command.make_parser(context).parse_args(words)
        arguments = [one for one in command.params if isinstance(one, click.Argument)]
        assert not left or len(left) <= len(arguments), line
        for option in command.params:
            assert not option.required or option.name in values, f"{line}: {option.name}"
            given = values.get(option.name)
            is_word = isinstance(given, str | list | tuple)  # and not an option without its value
            if is_word and isinstance(option.type, click.Choice | click.IntRange):
                for one in given if option.multiple else [given]:
                    option.type.convert(one, option, context)


def resolved(words: list[str]) -> tuple[click.Command, click.Context, list[str]]:
    """The command that words begin with, and the other words."""
    command: click.Command = main
    context = click.Context(main, info_name="wakedeploy")
    while isinstance(command, click.Group) and words and not words[0].startswith("-"):
        name, found, words = command.resolve_command(context, words)
        assert found is not None, name
        command, context = found, click.Context(found, info_name=name, parent=context)
    return command, context, list(words)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_scripts_have_these_options(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for line in of(page, "python "):
        _, *words = shlex.split(line.text)
        if words[0] == "-m":
            module = importlib.import_module(words[1])
            if hasattr(module, "__path__"):  # what -m runs of a package
                module = importlib.import_module(f"{words[1]}.__main__")
            monkeypatch.setattr(sys, "argv", [words[1], *words[2:]])
            if isinstance(getattr(module, "main", None), click.Command):
                assert module.main.make_context(words[1], words[2:]), line
            else:
                assert module._options(), line
        else:
            assert words[0] in files(page) or (ROOT / words[0]).is_file(), line


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_targets_of_make_and_tests_are_there(page: Path) -> None:
    for line in of(page, "make ", "pytest "):
        program, *words = shlex.split(line.text)
        if program == "make":
            subprocess.run(["make", "--dry-run", *words], cwd=ROOT, check=True, capture_output=True)
        else:
            assert all((ROOT / word).exists() for word in words if "/" in word), line


def test_every_line_is_good_shell() -> None:
    text = "\n".join(line.text for line in ALL)
    told = subprocess.run(["bash", "-n"], input=text, capture_output=True, text=True)
    assert (told.returncode, told.stderr) == (0, "")


def test_the_completion_of_a_shell_is_switched_on() -> None:
    (line,) = {x.text for x in READ if x.text.startswith("eval ")}
    where = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    told = subprocess.run(
        ["bash", "-c", f"{line}; complete -p wakedeploy"],
        env=os.environ | {"PATH": where}, capture_output=True, text=True,
    )  # fmt: skip
    assert "_wakedeploy_completion" in told.stdout, told.stderr


def obey(line: Line) -> None:
    """Run a command in this process, with its globs expanded as a shell would."""
    words: list[str] = []
    for word in shlex.split(line.small())[1:]:
        words += sorted(glob.glob(word)) or [word] if "*" in word else [word]
    told = CliRunner().invoke(main, words)
    assert told.exit_code == 0, f"{line}\n{line.small()}\n{told.output}"


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the first session was done, with what other pages take as given."""
    folder = tmp_path_factory.mktemp("workshop")
    before = Path.cwd()
    os.chdir(folder)
    try:
        (page,) = [page for page in PAGES if str(page).endswith(IN_ORDER)]
        for line in lines(page):
            obey(line)
        obey(Line("", 0, "wakedeploy rig init rig.toml"))
        shutil.copyfile("gru.mcap", "flight.mcap")
        Path("wakedeploy").mkdir()
        shutil.copyfile("gru.onnx", "wakedeploy/current.onnx")  # as `deploy` leaves it
    finally:
        os.chdir(before)
    return folder


@pytest.fixture(scope="module")
def flights(workshop: Path) -> None:
    """Flights in the workshop, of a plant that has what its rig file lacks."""
    (workshop / "flights").mkdir()
    (workshop / "plant.toml").write_text(default_rig_text() + MISSING, "utf-8")
    for seed in range(4):
        fly = f"run-gantry --baseline --virtual --plant-rig {workshop}/plant.toml --seed {seed}"
        obey(Line("", 0, f"wakedeploy {fly} --log {workshop}/flights/flight{seed}.mcap"))


def rehearse(page: Path, folder: Path, wanted: list[Line]) -> None:
    """Run these lines of a page, in a folder that holds its files."""
    for name, text in files(page).items():
        (folder / name).write_text(text, "utf-8")
    for line in wanted:
        for given in re.findall(r"run-gantry .*--log (\S+)|rig init (\S+)", line.small()):
            (folder / "".join(given)).unlink(missing_ok=True)  # is never overwritten
        obey(line)


def chosen(slow: bool) -> list[Path]:
    """Pages with such lines to run."""
    own = {line.page for line in RUN if line.is_slow is slow and line.page != IN_ORDER}
    return [page for page in PAGES if str(page.relative_to(ROOT)) in own]


@pytest.mark.whole
def test_the_commands_of_the_pages_work_in_their_order(
    workshop: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (first,) = [page for page in PAGES if str(page).endswith(IN_ORDER)]
    done = {line.small() for line in lines(first)}  # stands on several pages, and was run
    for page in chosen(slow=False):
        folder = tmp_path / page.stem
        shutil.copytree(workshop, folder)
        monkeypatch.chdir(folder)
        wanted = [x for x in lines(page) if x in RUN and not x.is_slow and x.small() not in done]
        rehearse(page, folder, wanted)


@pytest.mark.slow
@pytest.mark.parametrize("page", chosen(slow=True), ids=lambda page: page.name)
def test_the_slow_commands_of_a_page_work_in_their_order(
    page: Path, workshop: Path, flights: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "here"
    shutil.copytree(workshop, folder)
    monkeypatch.chdir(folder)
    rehearse(page, folder, [x for x in lines(page) if x in RUN])
    if page.name == "rig.md":
        calibrated = read_rig(Path("desk.toml")).calibration
        assert {name for name in CALIBRATIONS if name not in calibrated} == set()
        assert Path("wakedeploy/rig.toml").read_text("utf-8") == default_rig_text()
