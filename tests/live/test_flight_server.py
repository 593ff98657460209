"""What a page is shown of STOP, and of a loop that falls silent: the server, by a set clock."""

import contextlib
import socket
from types import SimpleNamespace

import pytest
from pages import begin, row

from runtime.io.live_feed import LiveFeed
from wakedeploy.live import flying
from wakedeploy.live.desk import ANSWER_S
from wakedeploy.live.flying import SILENT_S, FlightServer


class Flight:
    """A server with the loop's end of its socket, and a clock that a test sets."""

    def __init__(self, monkeypatch):
        self.now_s = 100.0
        monkeypatch.setattr(flying, "time", SimpleNamespace(monotonic=lambda: self.now_s))
        ours, self.its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.its.setblocking(False)
        self.feed, self.server = LiveFeed(ours), FlightServer(self.its)
        begin(self.feed)
        self.tick = 0

    def fly(self, **values):
        """One more row."""
        self.tick += 1
        self.feed.put(row(self.tick, **values))
        return self.after(1 / 32)

    def after(self, seconds):
        """What a page is shown some time later."""
        self.now_s += seconds
        self.server.read()
        self.server.look()
        return self.server.hub.state

    def stop(self):
        self.server.carry_out({"do": "stop"}, self.now_s)
        return self.server.hub.state


@pytest.fixture
def flight(monkeypatch):
    made = Flight(monkeypatch)
    yield made
    made.feed.close()
    made.its.close()


@pytest.mark.parametrize(
    "acting",
    [{"mode": "FAILSAFE", "faults": "operator_stop"}, {"mode": "LANDING"},
     {"mode": "ARMED", "faults": "late+operator_stop"}],
)  # fmt: skip
def test_stop_is_only_sent_until_a_row_shows_that_the_loop_acts(flight, acting):
    assert flight.fly()["stop"] == ""
    assert flight.stop()["stop"] == "sent"
    assert flight.fly()["stop"] == "sent"  # it was on its way already
    assert flight.fly(**acting)["stop"] == "acted on"
    assert flight.after(10.0)["stop"] == "acted on"


def test_a_loop_that_flies_on_after_stop_has_not_answered(flight):
    flight.stop()
    for _ in range(int(32 * ANSWER_S) - 1):
        assert flight.fly()["stop"] == "sent"
    flight.fly()
    assert flight.fly()["stop"] == "unanswered"
    assert flight.fly(mode="FAILSAFE")["stop"] == "acted on"


def test_stop_before_a_flight_is_answered_by_the_end_of_the_run(flight):
    flight.feed.tell({"phase": "about to fly"})
    flight.stop()
    assert flight.after(ANSWER_S + 0.1)["stop"] == "unanswered"
    flight.feed.tell({"phase": "ended", "ended": "before take-off"})
    assert flight.after(0.1)["stop"] == "acted on"


def test_a_stop_that_found_no_room_is_said_again(flight):
    with contextlib.suppress(BlockingIOError):
        while True:
            flight.its.send(b"free")
    flight.stop()
    assert not flight.feed.stop_asked()
    assert flight.after(ANSWER_S + 0.1)["stop"] == "unanswered"
    assert flight.feed.stop_asked()


def test_a_loop_without_rows_for_a_second_is_silent_until_the_next_one(flight):
    assert not flight.after(60.0)["silent"]  # the flight begins with its first row
    assert not flight.fly()["silent"]
    assert not flight.after(SILENT_S - 0.1)["silent"]
    assert flight.after(0.2)["silent"]
    assert not flight.fly()["silent"]
    flight.feed.tell({"phase": "ended", "ended": "whole"})
    assert not flight.after(60.0)["silent"]


def test_a_program_that_ended_is_not_silent(flight):
    flight.fly()
    flight.feed.close()
    state = flight.after(60.0)
    assert (state["phase"], state["silent"]) == ("ended", False)
