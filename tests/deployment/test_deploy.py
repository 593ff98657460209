"""`wakedeploy deploy` over a real ssh to a real sshd: what is current after whatever failed."""

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from click.testing import CliRunner
from made_packages import gantry_package, sound
from rig_over_ssh import ROOT, WITHOUT_TORCH, needs_sshd, running_rig
from warm_command import warm_command

from wakedeploy.cli import main
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.package import read_package, write_package
from wakedeploy.deploy.remote import Remote
from wakedeploy.physics.effects.chain import default_lead_s
from wakedeploy.rig.file import default_rig, default_rig_text

pytestmark = needs_sshd

PASSES = "#!/bin/sh\n"  # a check that is quick, where what it says is not the question
CLI = [sys.executable, "-c", "from wakedeploy.cli import main; main()", "deploy"]


@pytest.fixture
def installed(tmp_path):
    """A rig whose `wakedeploy` begins as a program does."""
    with running_rig(tmp_path) as running:
        yield running


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """The text of a `wakedeploy` that need not import for seconds what it runs."""
    with warm_command(tmp_path_factory.mktemp("warm") / "command", WITHOUT_TORCH) as text:
        yield text


@pytest.fixture
def rig(installed, begun):
    installed.command.write_text(begun)
    return installed


@pytest.fixture
def packages(tiny_package, tmp_path):
    """A function of a file's name: a package that passes `check`, another one for each name."""

    def write(name, **changes):
        made = tiny_package("state", **({"seed": len(list(tmp_path.glob("*.onnx")))} | changes))
        write_package(sound(made), tmp_path / name)
        return tmp_path / name

    return write


def arguments(rig, *more, config=None):
    return [
        "rig", *more, "-F", config or rig.config, "--directory", rig.site, "--command", rig.command
    ]  # fmt: skip


def deploy(rig, *more, config=None):
    told = [str(word) for word in arguments(rig, *more, config=config)]
    return CliRunner().invoke(main, ["deploy", *told])


def hashed(package):
    return f"packages/{read_package(package).sha256[:16]}.onnx"


def assert_refused(done, status, *sentences):
    assert done.exit_code == status, done.output
    *how_far, told = done.stderr.splitlines()
    assert len(how_far) <= 1, done.stderr
    for sentence in sentences:
        assert sentence in told


def assert_unchanged(rig, before):
    assert rig.links() == before
    end_s = time.monotonic() + 20.0
    while leftovers(rig) and time.monotonic() < end_s:
        time.sleep(0.05)  # the far end notices by itself that the line is gone
    assert leftovers(rig) == []


def leftovers(rig):
    return [
        path.name for path in rig.site.rglob("*") if not path.is_dir() and path.name.startswith(".")
    ]


@pytest.mark.whole
def test_deployed_twice_rolled_back_and_forth_again(installed, packages):
    rig = installed
    first, second = packages("first.onnx"), packages("second.onnx")
    done = deploy(rig, first)
    assert done.exit_code == 0, done.stderr
    assert rig.links() == {"current": hashed(first)}
    assert (rig.site / "current.onnx").read_bytes() == first.read_bytes()
    assert "no other one before it" in done.output

    done = deploy(rig, second)
    assert done.exit_code == 0, done.stderr
    assert rig.links() == {"current": hashed(second), "previous": hashed(first)}
    assert hashed(first).removeprefix("packages/") in done.output

    # The way back that was told is the way back.
    way = done.output.split("Back to it: ")[1]
    told = subprocess.run(
        ["sh", "-c", way.replace("wakedeploy deploy", '"$@"', 1), "sh", *CLI],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert told.returncode == 0, told.stderr
    assert rig.links() == {"current": hashed(first), "previous": hashed(second)}

    assert deploy(rig, "--rollback").exit_code == 0
    assert rig.links() == {"current": hashed(second), "previous": hashed(first)}
    assert leftovers(rig) == []


def test_the_same_package_again_keeps_the_one_before_it(rig, packages):
    rig.command.write_text(PASSES)
    first, second = packages("first.onnx"), packages("second.onnx")
    for package in (first, second, second):
        assert deploy(rig, package).exit_code == 0
    assert rig.links() == {"current": hashed(second), "previous": hashed(first)}


@pytest.mark.whole
def test_paths_start_in_the_home_folder(rig, packages):
    first = packages("first.onnx")
    from_home = os.path.relpath(rig.site, Path.home())
    command = os.path.relpath(rig.command, Path.home())
    done = CliRunner().invoke(
        main,
        ["deploy", "rig", str(first), "-F", str(rig.config), "--directory", f"~/{from_home}/",
         "--command", command],
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert (rig.site / "current.onnx").read_bytes() == first.read_bytes()


def test_a_target_that_is_no_name_is_not_called_a_lost_connection(packages):
    done = CliRunner().invoke(main, ["deploy", "pi@rig;x", str(packages("first.onnx"))])
    assert done.exit_code == 2
    assert "pi@rig;x: is no name of a host; give what ssh takes" in done.stderr


def test_what_is_no_package_is_told_with_what_to_give(packages, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = packages("first.onnx").name
    run = Path("runs/gru")
    run.mkdir(parents=True)
    for name in ("config.json", "best.safetensors"):
        (run / name).touch()
    for words, says in (
        (
            (file, "pi@rig"),
            "is a file, and the target comes first: `wakedeploy deploy pi@rig first",
        ),
        (
            (file, "ssh://pi@rig:2222"),
            "is a file, and the target comes first: `wakedeploy deploy ssh://pi@rig:2222 first",
        ),
        (("pi@rig", "runs/gru"), "make a package of it by `wakedeploy export --run runs/gru`"),
        (("pi@rig", "runs"), "runs: a folder with no C source"),
        (("pi@rig", file, "-F", "gone.cfg"), "pi@rig: ssh cannot open the file of -F; give one"),
    ):
        told = CliRunner().invoke(main, ["deploy", *words])
        assert told.exit_code == 2
        assert says in told.stderr
        assert "copy a folder of C" not in told.stderr


@pytest.mark.parametrize("mistyped", ["nope.onnx", "p/nope"])
def test_a_host_that_is_called_as_a_file_is_a_target(mistyped, packages, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("rigfile").touch()
    for host in ("rigfile", packages("first.onnx").name):
        told = CliRunner().invoke(main, ["deploy", host, mistyped])
        assert told.exit_code == 2
        assert told.stderr.startswith(f"Error: {mistyped}: ")
        assert "comes first" not in told.stderr


def test_a_broken_package_never_leaves(rig, packages, tmp_path):
    cut = tmp_path / "cut.onnx"
    cut.write_bytes(packages("first.onnx").read_bytes()[:-400])
    assert_refused(deploy(rig, cut), 2, "cut.onnx")
    assert not rig.site.exists()


@pytest.mark.whole
def test_a_package_that_fails_its_check_there_changes_nothing(rig, packages, tiny_package):
    assert deploy(rig, packages("first.onnx")).exit_code == 0
    before, lying = rig.links(), rig.config.with_name("lying.onnx")
    write_package(tiny_package("state"), lying)  # its record says that every force is zero
    done = deploy(rig, lying)
    assert_refused(done, 1, "failed there: The example rollout differs from its record")
    assert_unchanged(rig, before)


@pytest.mark.whole
def test_a_sound_package_for_another_loop_does_not_become_current(rig, packages, tmp_path):
    lead_s = default_lead_s(default_rig())
    fits, early = tmp_path / "fits.onnx", tmp_path / "early.onnx"
    write_package(gantry_package(lead_s), fits)
    write_package(gantry_package(lead_s + 0.1), early)
    assert deploy(rig, early).exit_code == 0  # without a rig file there nobody can know
    (rig.site / "rig.toml").write_text(default_rig_text())
    done = deploy(rig, fits)
    assert done.exit_code == 0, done.stderr
    before = rig.links()
    assert_refused(deploy(rig, packages("foreign.onnx")), 1, "it is not for the gantry")
    assert_refused(deploy(rig, early), 1, f"train with --lead {lead_s:g}")
    assert_refused(deploy(rig, "--rollback"), 1, f"train with --lead {lead_s:g}")
    slow = default_rig().changed(latency={"round_trip_s": 0.031})
    (rig.site / "rig.toml").write_text(slow.text)
    assert_refused(deploy(rig, fits), 1, "leaves no time for a prediction")
    assert rig.links() == before


def test_what_the_check_says_there_names_the_file_that_was_given(rig, packages):
    rig.command.write_text('#!/bin/sh\necho "Error: $(basename "$2"): too new" >&2; exit 2\n')
    assert_refused(deploy(rig, packages("mine.onnx")), 1, "failed there: mine.onnx: too new")
    assert_unchanged(rig, {})


def test_a_wakedeploy_that_is_missing_or_dies_there_is_named(rig, packages):
    rig.command.write_text(PASSES)
    first = packages("first.onnx")
    assert deploy(rig, first).exit_code == 0
    before, second = rig.links(), packages("second.onnx")
    rig.command.write_text("#!/bin/sh\nkill -ILL $$\n")  # what onnxruntime's wrong build does
    assert_refused(deploy(rig, second), 1, "ended there by SIGILL")
    rig.command.unlink()
    assert_refused(deploy(rig, second), 2, "to check the package with", "--command")
    assert_unchanged(rig, before)


def test_a_check_that_hangs_there_is_ended_there(rig, packages, monkeypatch, tmp_path):
    monkeypatch.setattr("wakedeploy.deploy.site.CHECK_LIMIT_S", 1)
    rig.command.write_text(f"#!/bin/sh\necho $$ > '{tmp_path}/checking'; exec sleep 60\n")
    done = deploy(rig, packages("first.onnx"))
    assert_refused(done, 1, "check` had not ended after 1 s and was ended there", "doctor` there")
    assert_unchanged(rig, {})
    assert not Path("/proc", (tmp_path / "checking").read_text().strip()).exists()


def test_a_check_that_does_not_hear_is_ended_all_the_same(rig, packages, monkeypatch):
    monkeypatch.setattr("wakedeploy.deploy.site.CHECK_LIMIT_S", 1)
    monkeypatch.setattr("wakedeploy.deploy.site._END_S", 0.5)
    rig.command.write_text("#!/bin/sh\ntrap '' TERM; while :; do sleep 0.1; done\n")
    assert_refused(deploy(rig, packages("first.onnx")), 1, "by SIGKILL", "it went on after 1 s")
    assert_unchanged(rig, {})


def test_a_machine_that_hangs_is_told_in_a_sentence(tmp_path, monkeypatch):
    (tmp_path / "ssh").write_text("#!/bin/sh\nexec sleep 60\n")
    (tmp_path / "ssh").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    began_s = time.monotonic()
    with pytest.raises(UnusableInput, match="rig: it lets ssh in, but had done nothing after 2 s"):
        Remote("rig").run("true", b"x" * 20_000, limit_s=1.0)
    assert time.monotonic() - began_s < 30.0  # of the sixty that it sleeps


def test_a_full_disk_is_named(rig, packages):
    rig.site.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", rig.site])
    if mounted.returncode:
        pytest.skip("no small disk can be mounted here")
    try:
        done = deploy(rig, packages("large.onnx", ballast=50_000))
        assert_refused(done, 1, "No space left on device", "free some space")
        assert_unchanged(rig, {})
    finally:
        subprocess.run(["umount", rig.site], check=True)


def test_a_file_of_somebody_s_is_not_replaced(rig, packages):
    rig.command.write_text(PASSES)
    rig.site.mkdir()
    (rig.site / "current.onnx").write_text("mine")
    assert_refused(deploy(rig, packages("first.onnx")), 2, "current.onnx is a file")
    assert (rig.site / "current.onnx").read_text() == "mine"
    assert leftovers(rig) == []


def test_without_an_earlier_package_there_is_no_way_back(rig, packages):
    rig.command.write_text(PASSES)
    assert_refused(deploy(rig, "--rollback"), 2, "no earlier package")
    assert deploy(rig, packages("first.onnx")).exit_code == 0
    before = rig.links()
    assert_refused(deploy(rig, "--rollback"), 2, "no earlier package")
    assert rig.links() == before


@pytest.mark.whole
def test_of_several_at_once_each_ends_right(rig, packages, begun, tmp_path):
    """Each makes its links under names of its own; the last one to exchange them stays."""
    rig.command.write_text(PASSES)
    (tmp_path / "here").write_text(begun)
    (tmp_path / "here").chmod(0o755)
    several = [packages(f"{name}.onnx") for name in "abcd"]
    assert deploy(rig, several[0]).exit_code == 0
    here = [tmp_path / "here", "deploy"]
    running = [started(rig, package, command=here) for package in several[1:] * 2]
    for run in running:
        _, err = run.communicate(timeout=120)
        assert run.returncode == 0, err
    links = rig.links()
    assert links["current"] in map(hashed, several[1:])
    assert links["previous"] in map(hashed, several)
    assert leftovers(rig) == []


@pytest.mark.whole
def test_a_previous_package_that_no_longer_passes_does_not_come_back(rig, packages):
    for name in ("first.onnx", "second.onnx"):
        assert deploy(rig, packages(name)).exit_code == 0
    before = rig.links()
    (rig.site / before["previous"]).write_bytes(b"gone bad")
    assert_refused(deploy(rig, "--rollback"), 1, "the previous package: not an ONNX model")
    assert rig.links() == before


def test_a_line_that_is_cut_in_the_middle_changes_nothing(rig, packages):
    rig.command.write_text(PASSES)
    assert deploy(rig, packages("first.onnx")).exit_code == 0
    before = rig.links()
    run, ssh = copying(rig, packages("large.onnx", ballast=750_000))
    os.kill(ssh, signal.SIGKILL)
    _, err = run.communicate(timeout=60)
    assert run.returncode == 2
    told = err.splitlines()  # a slow machine is told first what is going on
    assert [line for line in told if not line.startswith("Copying")] == told[-1:]
    assert "the connection was lost" in told[-1]
    assert_unchanged(rig, before)


def test_ctrl_c_in_the_middle_of_the_copy_changes_nothing(rig, packages):
    run, _ = copying(rig, packages("large.onnx", ballast=750_000))
    os.killpg(run.pid, signal.SIGINT)
    _, err = run.communicate(timeout=60)
    assert run.returncode == 130, err
    assert_unchanged(rig, {})


def test_ctrl_c_during_the_check_removes_the_copy(rig, packages, tmp_path):
    rig.command.write_text(f"#!/bin/sh\ntouch '{tmp_path}/checking'; sleep 5\n")
    run = started(rig, packages("first.onnx"))
    while not (tmp_path / "checking").exists():
        assert run.poll() is None, run.communicate()
        time.sleep(0.02)
    assert leftovers(rig) != []
    os.killpg(run.pid, signal.SIGINT)
    _, err = run.communicate(timeout=60)
    assert run.returncode == 130, err
    assert_unchanged(rig, {})


def started(rig, *more, config=None, command=CLI):
    line = [*command, *map(str, arguments(rig, *more, config=config))]
    return subprocess.Popen(
        line, cwd=ROOT, stdout=-1, stderr=-1, text=True, start_new_session=True
    )  # fmt: skip


def copying(rig, package):
    """A deployment that stands still in the middle of its copy, and the process of its ssh."""
    proxy = f"ProxyCommand {sys.executable} {Path(__file__).with_name('slow_line.py')}"
    slow = rig.configured("slow_config", "Host rig", f"  {proxy} {rig.port} 500000")
    run = started(rig, package, config=slow)
    while sum(path.stat().st_size for path in rig.site.rglob(".incoming-*")) < 100_000:
        assert run.poll() is None, run.communicate()
        time.sleep(0.02)
    children = Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split()
    return run, int(children[0])


def test_why_ssh_does_not_get_in_is_one_sentence(rig, packages):
    first = packages("first.onnx")
    folder = rig.config.parent

    def tried(*lines):
        return deploy(rig, first, config=rig.configured("tried_config", "Host rig", *lines))

    assert_refused(tried("  Port 9"), 2, "rig: no ssh server answers there")
    assert_refused(tried("  HostName nowhere.invalid"), 2, "no host of this name")
    shutil.copy(folder / "other_key", folder / "user_key")
    assert_refused(tried(), 2, "refused the key", "ssh-copy-id")
    (folder / "known_hosts").write_text("")
    assert_refused(tried(), 2, "host key is not known here")
    other = (folder / "other_key.pub").read_text().split()
    (folder / "known_hosts").write_text(f"[127.0.0.1]:{rig.port} {other[0]} {other[1]}\n")
    assert_refused(tried(), 2, "another than the known one")
    assert not rig.site.exists()


def test_where_there_is_no_ssh_it_says_what_to_install(rig, packages, monkeypatch):
    first = packages("first.onnx")
    monkeypatch.setenv("PATH", str(rig.config.parent))
    assert_refused(deploy(rig, first), 2, "install it (Debian: openssh-client)")


def test_either_a_package_or_the_way_back(rig, packages):
    assert_refused(deploy(rig), 2, "either deploy a PACKAGE")
    assert_refused(deploy(rig, packages("first.onnx"), "--rollback"), 2, "either deploy")


def test_a_folder_of_c_is_refused_with_the_commands_that_bring_it_there(rig, tmp_path):
    folder = tmp_path / "gru_c"
    folder.mkdir()
    (folder / "gru.c").write_text("int one;")
    rig.command.write_text('#!/bin/sh\necho "$@"; cat "$2/gru.c"\n')
    rig.site.mkdir()
    refused = deploy(rig, folder)
    assert_refused(refused, 2, "deploy takes a package's file")
    copy, check = refused.stderr.split("`")[1::2]
    subprocess.run(copy, shell=True, check=True)
    told = subprocess.run(check, shell=True, check=True, capture_output=True, text=True).stdout
    assert told == f"check {rig.site}/gru_c\nint one;"
    url = CliRunner().invoke(main, ["deploy", "ssh://pi@rig:2222", str(folder)])
    assert f"scp -r {folder} scp://pi@rig:2222/wakedeploy/`" in url.stderr
