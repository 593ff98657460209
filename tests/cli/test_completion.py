"""Completion by Tab: what it offers, what it loads, and what `--install-completion` writes."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from test_command_line import HEAVY

from wakedeploy.cli import main
from wakedeploy.cli.completion import SHELLS
from wakedeploy.core.names import architectures, domains

PROGRAMS = Path(sys.executable).parent  # where `wakedeploy` is


def environment(home: Path, shell: str = "bash", **more: str) -> dict[str, str]:
    kept = {name: os.environ[name] for name in ("PYTHONPATH",) if name in os.environ}
    path = f"{PROGRAMS}:{os.environ['PATH']}"
    return {**kept, "PATH": path, "HOME": str(home), "SHELL": f"/bin/{shell}", **more}


def answered(*words: str) -> list[str]:
    """What bash is answered at Tab behind the last of some words."""
    asked = {"COMP_WORDS": "\n".join(["wakedeploy", *words]), "COMP_CWORD": str(len(words))}
    done = CliRunner().invoke(
        main, [], prog_name="wakedeploy", env=asked | {"_WAKEDEPLOY_COMPLETE": "bash_complete"}
    )
    assert done.exit_code == 0, done.output
    return [line.partition(",")[2] for line in done.stdout.splitlines()]


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (["tr"], ["train"]),
        (["data", "make", ""], ["downwash", "gantry", "ship"]),
        (["gap", "cl"], ["close"]),
        (["train", "--see"], ["--seeds"]),
        (["train", "--arch", ""], [*architectures(), "all"]),
        (["train", "--arch", "M"], ["mamba"]),
        (["train", "--arch", "gru,"], [f"gru,{n}" for n in architectures() if n != "gru"]),
        (["train", "--arch", "gru,History_"], ["gru,history-mlp"]),
        (["train", "--arch", "=", "mam"], ["mamba"]),  # as bash cuts --arch=mam
        (["train", "--arch=mam"], ["--arch=mamba"]),  # where it does not
        (["tune", "--arch", "es"], ["esn"]),
        (["export", "--arch", "t"], ["tcn"]),
        (["train", "--device", "c"], ["cpu", "cuda"]),
        (["train", "--preset", "tu"], ["tuned"]),
        (["study", "domains", "--domains", ""], [*domains(), "all"]),
        (["gap", "plan", "--class", "coul"], ["coulomb-friction"]),
    ],
)
def test_commands_options_and_names_are_offered(words: list[str], offered: list[str]) -> None:
    assert answered(*words) == offered


@pytest.mark.parametrize(
    "words", ["tr", "train --ar", "train --arch g", "gap c", "study domains --domains g", "cal"]
)
def test_completion_loads_no_heavy_library(words: str) -> None:
    code = (
        "import sys\nfrom wakedeploy.cli import main\n"
        "try:\n    main(prog_name='wakedeploy')\nexcept SystemExit:\n    pass\n"
        f"print('LOADED', [name for name in {HEAVY} if name in sys.modules])"
    )
    line = f"wakedeploy {words}"
    asked = {"COMP_WORDS": line, "COMP_CWORD": str(len(words.split()))}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True,
        env=os.environ | asked | {"_WAKEDEPLOY_COMPLETE": "bash_complete"},
    )  # fmt: skip
    assert "plain," in done.stdout
    assert "LOADED []" in done.stdout


def installed(home: Path, *words: str, shell: str = "bash", **more: str) -> Result:
    told = environment(home, shell, **more)
    unset = dict.fromkeys(("XDG_DATA_HOME", "XDG_CONFIG_HOME", "ZDOTDIR"))
    return CliRunner().invoke(main, ["--install-completion", *words], env={**unset, **told})


WRITTEN = {
    "bash": (".local/share/wakedeploy/completion.bash", ".bashrc"),
    "zsh": (".local/share/wakedeploy/completion.zsh", ".zshrc"),
    "fish": (".config/fish/completions/wakedeploy.fish", None),
}


@pytest.mark.parametrize("shell", SHELLS)
def test_it_writes_for_the_persons_shell_once_and_says_how_to_undo_it(
    shell: str, tmp_path: Path
) -> None:
    script, startup = WRITTEN[shell]
    if startup:
        (tmp_path / startup).write_bytes(b"# mine, \xe4 in Latin-1\nalias ll='ls -l'")
    done = installed(tmp_path, shell=shell)
    assert done.exit_code == 0, done.output
    assert f"wrote {tmp_path / script}" in done.stdout
    assert f"To undo it, delete {tmp_path / script}" in done.stdout
    assert "_WAKEDEPLOY_COMPLETE" in (tmp_path / script).read_text()
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert len(before) == (2 if startup else 1)
    if startup:
        *own, line = (tmp_path / startup).read_bytes().splitlines()
        assert own == [b"# mine, \xe4 in Latin-1", b"alias ll='ls -l'"]
        assert str(tmp_path / script).encode() in line
        assert line.decode().endswith("# wakedeploy: completion by Tab")
    again = installed(tmp_path, shell)
    assert again.exit_code == 0
    assert "is in place already" in again.stdout
    assert before == {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}


def test_a_folder_with_a_blank_and_folders_of_ones_own_are_used(tmp_path: Path) -> None:
    home = tmp_path / "my home"
    home.mkdir()
    more = {"XDG_DATA_HOME": str(home / "data"), "ZDOTDIR": str(home / "zsh")}
    assert installed(home, "zsh", **more).exit_code == 0
    assert (home / "data" / "wakedeploy" / "completion.zsh").is_file()
    assert f"'{home / 'data'}" in (home / "zsh" / ".zshrc").read_text()


def test_a_startup_file_that_is_a_link_stays_one(tmp_path: Path) -> None:
    (tmp_path / "dotfiles").mkdir()
    real = tmp_path / "dotfiles" / "bashrc"
    real.write_text("# mine\n")
    (tmp_path / ".bashrc").symlink_to(real)
    assert installed(tmp_path).exit_code == 0
    assert (tmp_path / ".bashrc").is_symlink()
    assert real.read_text().startswith("# mine\n")
    assert "completion.bash" in real.read_text()


def test_what_cannot_be_read_or_is_somebody_elses_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / ".bashrc").mkdir()
    done = installed(tmp_path, "bash")
    assert done.exit_code == 2
    assert ".bashrc: cannot be read (Is a directory), so nothing was written." in done.stderr
    assert [*tmp_path.rglob("*")] == [tmp_path / ".bashrc"]
    theirs = tmp_path / WRITTEN["fish"][0]
    theirs.parent.mkdir(parents=True)
    theirs.write_text("# my own\n")
    done = installed(tmp_path, "fish")
    assert done.exit_code == 2
    assert "wakedeploy.fish: is not of wakedeploy; move it away first." in done.stderr
    assert theirs.read_text() == "# my own\n"


def test_another_shell_has_to_be_one_that_is_known(tmp_path: Path) -> None:
    done = installed(tmp_path, shell="dash")
    assert done.exit_code == 2
    assert "$SHELL is /bin/dash; say for which shell" in done.stderr
    assert installed(tmp_path, "tcsh").exit_code == 2
    assert [*tmp_path.rglob("*")] == []


def shell_says(shell: str, home: Path, script: str) -> list[str]:
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"to run them: sudo apt install {shell}")
    done = subprocess.run(
        [program, "-c", script], env=environment(home, shell), cwd=home, text=True,
        capture_output=True, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout.split("\n")


BASH_TAB = (
    "COMP_WORDS=(wakedeploy {words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1)); {tab} wakedeploy;"
    ' printf "%s\\n" "${{COMPREPLY[@]}}"; COMPREPLY=();'
)


@pytest.mark.parametrize(
    "load", ['. "$HOME/.bashrc"', 'eval "$(_WAKEDEPLOY_COMPLETE=bash_source wakedeploy)"']
)
def test_bash_completes(load: str, tmp_path: Path) -> None:
    assert installed(tmp_path, "bash").exit_code == 0
    function = "_wakedeploy_completion"
    tabs = [BASH_TAB.format(words=words, tab=function) for words in
            ("trai", "train --arch gru,t", "train --arch = ma")]  # fmt: skip
    told = shell_says("bash", tmp_path, f"{load}; complete -p wakedeploy; {' '.join(tabs)}")
    assert told[0] == f"complete -o nosort -F {function} wakedeploy"
    assert told[1:4] == ["train", "gru,tcn", "mamba"]


def test_zsh_completes(tmp_path: Path) -> None:
    assert installed(tmp_path, "zsh").exit_code == 0
    told = shell_says("zsh", tmp_path, '. "$HOME/.zshrc"; print $_comps[wakedeploy]')
    assert told[-2] == "_wakedeploy_completion"


def test_fish_completes_with_whole_descriptions(tmp_path: Path) -> None:
    assert installed(tmp_path, "fish").exit_code == 0
    for words, told in (
        ("gap cl", "close\tFind, name, add"),
        ("train --arch gru,t", "gru,tcn"),
        ("train --arch=ma", "--arch=mamba"),
    ):
        (first, *_) = shell_says("fish", tmp_path, f"complete -C 'wakedeploy {words}'")
        assert first.startswith(told)
