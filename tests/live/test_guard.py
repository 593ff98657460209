"""Who may come to a page, and what a page may ask for: decisions alone, without a server."""

import shlex

import pytest

from runtime.io.live_feed import FREE, HELD, STOP
from wakedeploy.core.errors import UnusableInput
from wakedeploy.live.address import (
    Address,
    Allowance,
    address_of,
    fits,
    is_our_host,
    is_our_origin,
    token_for,
)
from wakedeploy.live.desk import HOLD_S, Desk

HERE, LAN = Address("127.0.0.1", 8032), Address("0.0.0.0", 8032)


@pytest.mark.parametrize("host", ["127.0.0.1:8032", "localhost:9", "[::1]:8032", "127.0.0.1"])
def test_this_machine_is_named_by_any_port(host):
    assert is_our_host(host, HERE)  # ssh -L brings another port


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example:8032", "192.168.0.7", ""])
def test_a_rebound_name_is_refused(host):
    assert not is_our_host(host, HERE)


def test_an_open_address_is_named_by_number_or_by_its_own_name(monkeypatch):
    monkeypatch.setattr("socket.gethostname", lambda: "Rig")
    assert is_our_host("192.168.0.7:8032", LAN)
    assert is_our_host("rig.local:8032", LAN)
    assert not is_our_host("evil.example:8032", LAN)


def test_an_origin_is_the_same_host_and_port():
    assert is_our_origin("http://127.0.0.1:8032", "127.0.0.1:8032")
    assert not is_our_origin("http://127.0.0.1:8033", "127.0.0.1:8032")
    assert not is_our_origin("null", "127.0.0.1:8032")
    assert not is_our_origin(None, "127.0.0.1:8032")


def test_a_token_fits_whole_or_not():
    assert fits("abc", "abc")
    assert not any(fits(wrong, "abc") for wrong in ("ab", "abcd", "", None, 7, "äbc"))


def test_addresses_are_read_and_refused_in_a_sentence():
    assert address_of("[::1]:80") == Address("::1", 80)
    assert address_of("/run/x/live").path.name == "live"
    for wrong in ("8032", "host", "host:", ":80", "h:99999", "h:x"):
        with pytest.raises(UnusableInput, match="is no address"):
            address_of(wrong)


def test_the_line_to_a_socket_survives_a_shell_and_another_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    line = address_of("my pages/live").link("token").split(" that runs: ")[1]
    assert f"8032:{tmp_path}/my pages/live" in shlex.split(line)
    assert " 8032:/run/live " in address_of("/run/live").link("token")


def test_other_computers_come_only_with_a_kept_token(tmp_path):
    with pytest.raises(UnusableInput, match="--live-token"):
        token_for(LAN, None)
    kept = tmp_path / "token"
    first = token_for(LAN, kept)
    assert token_for(LAN, kept) == first
    assert len(first) >= 32
    assert kept.stat().st_mode & 0o077 == 0
    assert token_for(HERE, None) != token_for(HERE, None)
    kept.write_text("too short")
    with pytest.raises(UnusableInput, match="a token has 16"):
        token_for(LAN, kept)


def test_an_allowance_refills():
    some = Allowance(2.0, 3)
    assert [some.take(100.0) for _ in range(4)] == [True, True, True, False]
    assert [some.take(100.5), some.take(100.5)] == [True, False]


@pytest.fixture
def said():
    return []


@pytest.fixture
def desk(said, tmp_path):
    made = Desk(said.append)
    made.arm_file = tmp_path / "fly"
    return made


def test_two_steps_make_the_file_and_tell_the_loop_that_a_page_watches(desk, said):
    word = desk.ask(10.0)
    assert not desk.arm_file.exists()
    assert desk.confirm(word, "me", 11.0) == ""
    assert desk.arm_file.exists()
    assert said == [HELD]


@pytest.mark.parametrize("after_s", [0.1, 10.5])
def test_the_second_step_has_its_time(desk, after_s):
    word = desk.ask(10.0)
    assert "Too late or too soon" in desk.confirm(word, "me", 10.0 + after_s)
    assert not desk.arm_file.exists()


def test_a_word_serves_once_and_a_wrong_one_never(desk):
    word = desk.ask(10.0)
    assert desk.confirm("other", "me", 11.0) != ""
    assert desk.confirm(word, "me", 11.0) == ""
    desk.arm_file.unlink()
    assert desk.confirm(word, "me", 11.5) != ""
    assert not desk.arm_file.exists()


def test_nothing_is_begun_after_a_stop_or_without_a_standby(desk):
    word = desk.ask(10.0)
    desk.arm_file.touch()  # somebody else's
    desk.stop("pressed", 10.5)
    assert not desk.arm_file.exists()
    assert desk.confirm(word, "me", 11.0) != ""
    assert desk.ask(20.0) is None
    desk.stopped, desk.arm_file = "", None
    assert desk.ask(30.0) is None


def test_a_page_that_is_gone_holds_nothing(desk, said):
    desk.confirm(desk.ask(10.0), "me", 11.0)
    desk.beat("me", 12.0)
    desk.look(12.0 + HOLD_S - 0.1)
    assert STOP not in said
    desk.beat("another", 14.0)
    desk.look(12.0 + HOLD_S + 0.1)
    assert said == [HELD, STOP]
    assert "not heard" in desk.stopped


def test_after_the_flight_nobody_has_to_watch(desk, said):
    desk.confirm(desk.ask(10.0), "me", 11.0)
    desk.release()
    desk.look(1000.0)
    assert said == [HELD, FREE]


def test_asking_is_limited(desk):
    assert [desk.ask(10.0) is not None for _ in range(5)] == [True, True, True, False, False]
