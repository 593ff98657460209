"""The loop's end of a live page: it drops, counts and never waits, and hears STOP for good."""

import json
import socket
import time

import pytest

from runtime.io.live_feed import FREE, HELD, STOP, LiveFeed

ROW = {"tick": 7, "t_s": 0.25, "z_est_m": 0.4, "mode": "RUNNING", "faults": ""}


@pytest.fixture
def ends():
    ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    with ours, its:
        yield LiveFeed(ours), its


def test_a_row_arrives_as_it_was_given(ends):
    feed, its = ends
    feed.put(ROW)
    assert json.loads(its.recv(65536)) == {"row": ROW, "dropped": 0}


def test_what_nobody_reads_is_dropped_and_counted_without_waiting(ends):
    feed, its = ends
    began_s = time.monotonic()
    for _ in range(5000):
        feed.put(ROW)
    assert time.monotonic() - began_s < 2.0  # none of them waited, or the test would hang
    arrived = 0
    its.setblocking(False)
    try:
        while its.recv(65536):
            arrived += 1
    except BlockingIOError:
        pass
    assert 32 <= arrived < 1000
    assert (feed.offered, feed.dropped) == (5000, 5000 - arrived)
    feed.put(ROW)
    assert json.loads(its.recv(65536))["dropped"] == feed.dropped


def test_a_stop_stays(ends):
    feed, its = ends
    assert not feed.stop_asked()
    its.send(STOP)
    assert feed.stop_asked()
    its.send(FREE)
    assert feed.stop_asked()


@pytest.mark.parametrize(("words", "stops"), [([], False), ([HELD], True), ([HELD, FREE], False)])
def test_a_process_that_is_gone_ends_only_a_flight_that_its_page_began(ends, words, stops):
    feed, its = ends
    for word in words:
        its.send(word)
    its.close()
    assert feed.stop_asked() is stops
    assert feed.is_gone
    feed.put(ROW)  # no error
    assert feed.dropped == 1


def test_what_cannot_be_told_is_dropped(ends):
    feed, _ = ends
    feed.put({"t_s": object()})
    assert feed.dropped == 1
