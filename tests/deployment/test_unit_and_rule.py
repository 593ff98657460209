"""The files for the Pi, judged by those who read them there: systemd's verifier and udev itself."""

import re
import shutil
import subprocess
from pathlib import Path

import needs
import pytest

from runtime.io.recorder import CLOSE_LIMIT_S
from runtime.loop.blind import ladder_s
from runtime.loop.descent import DESCENT_LIMIT, DESCENT_MPS
from runtime.loop.settling import LONGEST_S
from runtime.loop.way_down import DEADMAN_S
from wakedeploy.cli.run_gantry import command as run_gantry
from wakedeploy.rig.file import default_rig

FOLDER = Path(__file__).parents[2] / "deployment"
UNIT, RULES = FOLDER / "wakedeploy-gantry@.service", FOLDER / "60-wakedeploy.rules"

VERIFIER = shutil.which("systemd-analyze")


def verified(folder, text):
    """What systemd says about the unit, an installed wakedeploy and a user assumed."""
    unit = folder / "wakedeploy-gantry@root.service"
    unit.write_text(text.replace("/opt/wakedeploy/bin/wakedeploy", "/bin/true"))
    ended = subprocess.run(
        [VERIFIER, "verify", unit], capture_output=True, text=True, check=False
    )  # fmt: skip
    return ended.stdout + ended.stderr + ("" if ended.returncode == 0 else "refused")


@needs.systemd
def test_systemd_has_nothing_to_say_about_the_unit(tmp_path):
    assert verified(tmp_path, UNIT.read_text()) == ""


@needs.systemd
@pytest.mark.parametrize(
    ("word", "wrong", "told"),
    [
        ("WatchdogSec=", "WatchdogSek=", "Unknown key"),
        ("Restart=always", "Restart=ever", "Failed to parse"),
        ("/opt/wakedeploy/bin/wakedeploy", "/opt/none", "not executable"),
    ],
)
def test_the_verifier_notices_what_is_wrong(tmp_path, word, wrong, told):
    assert told in verified(tmp_path, UNIT.read_text().replace(word, wrong))


def settings(name):
    return re.findall(rf"^{name}=(.*)$", UNIT.read_text().replace("\\\n", " "), re.MULTILINE)


def test_the_unit_flies_only_when_asked_and_its_command_exists():
    (line,) = settings("ExecStart")
    program, command, *options = line.replace("$OPTIONS", "").split()
    assert (program, command) == ("/opt/wakedeploy/bin/wakedeploy", "run-gantry")
    with run_gantry.make_context("run-gantry", options) as parsed:
        params = parsed.params
    (folder,) = settings("RuntimeDirectory")  # systemd removes it whenever the service ends
    assert params["arm_file"] == Path("/run") / folder / "fly"
    assert settings("RuntimeDirectoryPreserve") == []
    assert settings("ExecStartPre") == settings("ExecStartPost") == []
    assert params["realtime"]
    assert not params["virtual"]
    assert f'SYMLINK+="{params["port"].removeprefix("/dev/")}"' in RULES.read_text()


def test_an_option_that_a_drop_in_adds_reaches_the_command_and_none_is_there_before():
    (line,), environment = settings("ExecStart"), settings("Environment")
    assert "OPTIONS=" in environment
    _, _, *options = line.replace("$OPTIONS", "--backend c").split()
    with run_gantry.make_context("run-gantry", options) as parsed:
        assert parsed.params["backend"] == "c"
    (kept,) = [e.partition("=")[2] for e in environment if e.startswith("XDG_CACHE_HOME=")]
    (writable,) = settings("BindPaths")
    assert Path(kept).is_relative_to(writable), "C is kept from one start to the next"


def test_a_restart_does_not_reset_the_board_on_its_way_down():
    (pause_s,) = settings("RestartSec")
    assert float(pause_s) > DEADMAN_S + ladder_s(default_rig().limits) + 1.0


def test_the_unit_leaves_time_to_land_and_flights_do_not_count_as_failures():
    (stop,), (burst,) = settings("TimeoutStopSec"), settings("StartLimitBurst")
    (interval,), (signals,) = settings("StartLimitIntervalSec"), settings("KillMode")
    down_s = DESCENT_LIMIT * default_rig().limits.z_m[1] / DESCENT_MPS
    assert float(stop) > down_s + LONGEST_S + CLOSE_LIMIT_S
    assert signals == "mixed"
    shortest_s = 6.0 + 2 * 3.0  # `--seconds 6`, and the rest before and after it
    assert float(burst) * shortest_s >= float(interval)


BOARDS = [("2341", "0043"), ("2341", "0001"), ("2a03", "0043"), ("1a86", "7523")]
# udev reads what it knows of a device below /sys. In a mount namespace of its own it gets another
# one, with a USB device that has a serial port, a /run with the project's rules alone, and a /dev:
# also when it only tests, it makes the links there.
NAMESPACE = """
set -e
mount -t tmpfs tmpfs /run
mount -t tmpfs tmpfs /dev
mknod -m 666 /dev/null c 1 3
mkdir -p /run/udev/rules.d && cp "$RULES" /run/udev/rules.d/
mount --bind "$SYS" /sys
SYSTEMD_DEVICE_VERIFY_SYSFS=0 udevadm test "$DEVICE" 2>&1
"""


def missing_for_udev():
    """Why udev cannot be asked here; None where it can."""
    if shutil.which("udevadm") is None or shutil.which("unshare") is None:
        return f"{needs.NOT_INSTALLED}udev util-linux mount"
    tried = subprocess.run(
        ["unshare", "--mount", "mount", "-t", "tmpfs", "tmpfs", "/run"],
        capture_output=True, check=False,
    )  # fmt: skip
    return "no mount namespace may be made here" if tried.returncode else None


@pytest.fixture(scope="module")
def udev():
    why = missing_for_udev()
    if why is not None:
        pytest.skip(why)


def fake_sys(folder, vendor, product):
    """A /sys with one USB device, whose one interface has one serial port: device and port."""
    device = folder / "devices" / "pci0000:00" / "usb1" / "1-1"
    interface = device / "1-1:1.0"
    port = interface / "tty" / "ttyACM0"
    port.mkdir(parents=True)
    for subsystem in ("bus/usb", "class/tty"):
        (folder / subsystem).mkdir(parents=True)
    (device / "idVendor").write_text(f"{vendor}\n")
    (device / "idProduct").write_text(f"{product}\n")
    (device / "uevent").write_text("DEVTYPE=usb_device\n")
    (interface / "uevent").write_text("DEVTYPE=usb_interface\n")
    (port / "uevent").write_text("MAJOR=166\nMINOR=0\nDEVNAME=ttyACM0\n")
    for where, subsystem in ((device, "bus/usb"), (interface, "bus/usb"), (port, "class/tty")):
        up = "../" * len(where.relative_to(folder).parts)
        (where / "subsystem").symlink_to(f"{up}{subsystem}")
    return device, port


def told_by_udev(folder, device, rules=RULES):
    """The properties that the rules give a device, and all that udev said."""
    environment = {
        "PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "RULES": str(rules), "SYS": str(folder),
        "DEVICE": f"/sys/{device.relative_to(folder)}",
    }  # fmt: skip
    ended = subprocess.run(
        ["unshare", "--mount", "sh", "-c", NAMESPACE],
        env=environment, capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    said = ended.stdout + ended.stderr
    assert ended.returncode == 0, said
    assert not Path("/dev/wakedeploy-uno").is_symlink()  # this machine is as it was
    return dict(re.findall(r"^([A-Z_]+)=(.*)$", said, re.MULTILINE)), said


@pytest.mark.usefixtures("udev")
@pytest.mark.parametrize(("vendor", "product"), BOARDS)
def test_udev_names_the_port_of_each_board_and_keeps_modem_manager_away(tmp_path, vendor, product):
    device, port = fake_sys(tmp_path, vendor, product)
    properties, said = told_by_udev(tmp_path, port)
    assert "/dev/wakedeploy-uno" in properties["DEVLINKS"].split()
    assert properties["ID_MM_PORT_IGNORE"] == properties["ID_MM_DEVICE_IGNORE"] == "1"
    assert "systemd" in properties["TAGS"].split(":")
    assert re.search(r"60-wakedeploy.rules:\d+ MODE 0660", said)
    assert re.search(r"60-wakedeploy.rules:\d+ GROUP \d+", said)
    properties, _ = told_by_udev(tmp_path, device)
    assert properties["ID_MM_DEVICE_IGNORE"] == "1"
    assert "DEVLINKS" not in properties


@pytest.mark.usefixtures("udev")
def test_udev_leaves_another_board_alone(tmp_path):
    _, port = fake_sys(tmp_path, "2341", "8036")  # a Leonardo
    properties, _ = told_by_udev(tmp_path, port)
    assert "wakedeploy" not in properties.get("DEVLINKS", "")
    assert "ID_MM_DEVICE_IGNORE" not in properties


@pytest.mark.usefixtures("udev")
def test_udev_has_nothing_to_say_about_the_rules_and_would_about_wrong_ones(tmp_path):
    _, port = fake_sys(tmp_path / "sys", *BOARDS[0])
    complaint = re.compile(r"60-wakedeploy.rules:\d+ (Invalid|Unknown|.*ignoring)")
    assert not complaint.search(told_by_udev(tmp_path / "sys", port)[1])
    wrong = tmp_path / RULES.name
    wrong.write_text(RULES.read_text().replace("SYMLINK+=", "SIMLINK+="))
    assert complaint.search(told_by_udev(tmp_path / "sys", port, wrong)[1])
