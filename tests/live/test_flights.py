"""A folder of flights: listed from files or the cache, drawn, exported, and in a real browser."""

import asyncio
import json
import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import needs
import numpy as np
import pytest
from browser import PHONE, chromium
from click.testing import CliRunner
from pages import Client, serving

from wakedeploy.cli import main
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.run_summary import summarise
from wakedeploy.core.runlog import RunLog, read_run_log
from wakedeploy.domains.gantry import record
from wakedeploy.live import flights as module
from wakedeploy.live.address import address_of
from wakedeploy.live.browse import Flights, handlers
from wakedeploy.live.events import events_of
from wakedeploy.live.flight_data import flight_data
from wakedeploy.live.flights import Index, cache_file, row_of
from wakedeploy.live.replay import Replay
from wakedeploy.live.web import application, bound, serve


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    """A cache of these tests' own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def folder(tmp_path_factory, home):
    """Three flights, one of them with faults and a gap score, one file that is none, a report."""
    made = tmp_path_factory.mktemp("flights")
    for seed in range(2):
        log = record(None, seconds=6, seed=seed)
        log.metadata["started_utc"] = f"2026-01-0{seed + 1}T10:00:00+00:00"
        log.write_mcap(made / f"flight{seed}.mcap")
    rows = list(record(None, seconds=6, seed=2).rows())
    for one in rows[100:104]:
        one["faults"] = "late"
    for one in rows[150:]:
        one["faults"], one["gap_score"] = "range_bad+late", 1.7
    (made / "below").mkdir()
    RunLog.from_rows(rows, {"started_utc": "2026-01-03T10:00:00+00:00"}).write_mcap(
        made / "below" / "<b>.mcap"
    )
    (made / "broken.mcap").write_bytes(b"no log")
    (made / "below" / "report.html").write_text("<p>the report</p>")
    (made / "secret.toml").write_text("nobody's")
    return made


@pytest.fixture(scope="module")
def served(folder):
    with serving("log", "browse", folder) as url:
        yield url


@pytest.mark.whole
def test_rows_are_what_log_show_says(folder):
    index = Index(folder)
    index.refresh()
    rows = {row["name"]: row for row in index.rows()}
    assert set(rows) == {"flight0.mcap", "flight1.mcap", "below/<b>.mcap", "broken.mcap"}
    told = summarise(read_run_log(folder / "flight1.mcap"))
    assert rows["flight1.mcap"]["tracking_mm"] == pytest.approx(
        1e3 * told.tracking_rmse_m, abs=0.01
    )
    assert rows["flight1.mcap"]["seconds"] == pytest.approx(told.duration_s, abs=0.05)
    assert rows["below/<b>.mcap"]["faults"] == {"late": 2, "range_bad": 1}
    assert rows["below/<b>.mcap"]["gap"] == 1.7
    assert rows["below/<b>.mcap"]["rig"] == ""  # the log does not say
    assert "is not an MCAP run log" in rows["broken.mcap"]["problem"]


def test_a_list_and_a_drawing_round_an_error_as_log_show_does(tmp_path):
    """47.3487 mm are 47.3 mm; rounded to 47.35 mm before, they would be 47.4 mm."""
    modes = ["ARMED", "RUNNING", "RUNNING"]
    ticks = [
        {"tick": i, "t_s": i / 32, "z_ref_m": 0.0473487, "z_est_m": 0.0, "mode": mode, "faults": ""}
        for i, mode in enumerate(modes)
    ]
    path = tmp_path / "flight.mcap"
    RunLog.from_rows(ticks).write_mcap(path)
    for told in (row_of(path), flight_data(path, path.name)):
        assert told["tracking_mm"] == pytest.approx(47.3487, abs=1e-9)


@pytest.mark.whole
def test_a_row_names_rig_and_package_and_has_no_date_that_was_none(folder, tmp_path):
    log = record(None, seconds=2, seed=0)
    log.write_mcap(tmp_path / "bare.mcap")
    row = row_of(tmp_path / "bare.mcap")
    assert (row["started"], row["simulated"], row["package"]) == ("", True, "PID alone")
    assert row["rig"] == log.metadata["rig_sha256"][:8]
    drawn = flight_data(tmp_path / "bare.mcap", "bare.mcap")
    assert (drawn["started"], drawn["simulated"]) == ("", True)
    log.metadata |= {"rig_file": "heavy.toml", "package_file": "gru.onnx"}
    log.metadata |= {"package_sha256": 16 * "01234567"}
    log.write_mcap(tmp_path / "named.mcap")
    row = row_of(tmp_path / "named.mcap")
    assert row["rig"] == f"heavy.toml {log.metadata['rig_sha256'][:8]}"
    assert row["package"] == "gru.onnx 01234567"


@pytest.mark.whole
def test_the_cache_is_asked_first_and_a_changed_file_is_read_again(folder, monkeypatch):
    Index(folder).refresh()
    read = []
    whole = module.row_of
    monkeypatch.setattr(module, "row_of", lambda path: read.append(path.name) or whole(path))
    Index(folder).refresh()
    assert read == []
    os.utime(folder / "flight0.mcap", ns=(1, time.time_ns()))
    index = Index(folder)
    assert [row for row in index.rows() if "waits" in row] == [
        {"name": "flight0.mcap", "waits": True}
    ]
    index.refresh()
    assert read == ["flight0.mcap"]


@pytest.mark.whole
@pytest.mark.parametrize(
    "damage", ["", "{", "[]", '{"version": 1, "logs": {"a": 3}}', '{"version": 9}']
)
def test_a_damaged_cache_is_no_cache(folder, damage):
    Index(folder).refresh()
    cache_file(folder).write_text(damage)
    index = Index(folder)
    index.refresh()
    assert all("waits" not in row for row in index.rows())


@pytest.mark.whole
def test_events_are_changes_of_mode_and_onsets_of_faults(folder):
    found = events_of(read_run_log(folder / "below" / "<b>.mcap"))
    assert [name for _, kind, name in found if kind == "fault"] == ["late", "late", "range_bad"]
    assert [name for _, kind, name in found if kind == "mode"][:2] == ["ARMED", "RUNNING"]


def test_a_folder_that_is_not_there_is_a_sentence(tmp_path):
    told = CliRunner().invoke(main, ["log", "browse", str(tmp_path / "none")])
    assert told.exit_code == 2
    assert "there is no such folder" in told.output


@pytest.mark.whole
def test_nothing_is_told_without_the_token_and_nothing_but_listed_flights_and_reports(served):
    client = Client(served)
    token = {"Authorization": f"Bearer {client.token}"}
    assert client.ask("GET", "/api/flights")[0] == 401
    assert client.ask("GET", "/api/flights", Authorization="Bearer x")[0] == 401
    status, _, body = client.ask("GET", "/api/flights", **token)
    assert status == 200
    listed = json.loads(body)
    assert listed["reports"] == ["below/report.html"]
    for name in ("../secret.toml", "secret.toml", "/etc/passwd", "below/../secret.toml"):
        assert client.ask("GET", f"/api/flight?name={name}", **token)[0] == 404
        assert client.ask("GET", f"{listed['way']}{name}")[0] == 404
    status, headers, body = client.ask("GET", f"{listed['way']}below/report.html")
    assert (status, body) == (200, "<p>the report</p>")
    assert "sandbox" in headers["Content-Security-Policy"]
    assert client.ask("GET", "/report/0000/below/report.html")[0] == 404
    assert client.ask("POST", "/api/flights", Origin=f"http://{client.host}", **token)[0] == 405


@pytest.mark.whole
def test_one_flight_is_read_once_however_many_ask_at_a_time(folder, monkeypatch):
    read, may_end = [], threading.Event()

    def slowly(path, name):
        read.append(name)
        assert may_end.wait(10.0)
        if len(read) == 1:
            raise UnusableInput("the disk was busy")
        return {"name": name}

    monkeypatch.setattr("wakedeploy.live.browse.flight_data", slowly)
    flights = Flights(folder, "token")
    with ThreadPoolExecutor(4) as pool:
        asked = [pool.submit(flights.data, "flight0.mcap") for _ in range(4)]
        while not read:
            time.sleep(0.01)
        time.sleep(0.1)  # for the others to ask
        may_end.set()
        assert [str(one.exception()) for one in asked] == 4 * ["the disk was busy"]
    assert read == ["flight0.mcap"]
    assert flights.data("flight0.mcap") is flights.data("flight0.mcap")  # a failure is not kept
    assert len(read) == 2


@pytest.mark.whole
def test_flights_that_nobody_waits_for_any_longer_are_not_read(folder, tmp_path, monkeypatch):
    """Who walks down a list by its keys waits for the last one, and for none on the way there."""
    names = [f"{number}.mcap" for number in range(8)]
    for name in (*names, "in-memory.mcap"):
        os.link(folder / "flight0.mcap", tmp_path / name)
    read, may_end = [], threading.Event()

    def slowly(path, name):
        read.append(name)
        assert may_end.wait(10.0)
        return {"name": name}

    async def asked(address, name):
        reader, writer = await asyncio.open_connection(*address)
        writer.write(
            f"GET /api/flight?name={name} HTTP/1.1\r\nHost: 127.0.0.1:{address[1]}\r\n"
            "Authorization: Bearer token\r\nConnection: close\r\n\r\n".encode()
        )
        await writer.drain()
        return reader, writer

    async def walked():
        sockets, address = bound(address_of("127.0.0.1:0"))
        here = sockets[0].getsockname()[:2]
        app = application(address, "token", "browse.html", handlers(Flights(tmp_path, "token")))
        serve(sockets, app)
        reader, _ = await asked(here, "in-memory.mcap")
        may_end.set()
        await reader.read()
        may_end.clear()
        everyone = [await asked(here, name) for name in names]
        while len(read) < 3:
            await asyncio.sleep(0.01)
        again, _ = await asked(here, "in-memory.mcap")  # behind none of them
        assert (await again.read()).endswith(b'[{"name":"in-memory.mcap"}]')
        for _, writer in everyone[:-1]:
            writer.close()
        await asyncio.sleep(0.2)  # for the server to hear of it
        may_end.set()
        return await everyone[-1][0].read()

    monkeypatch.setattr("wakedeploy.live.browse.flight_data", slowly)
    assert asyncio.run(walked()).endswith(b'[{"name":"7.mcap"}]')
    assert sorted(read) == ["0.mcap", "1.mcap", "7.mcap", "in-memory.mcap"]


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


def names(browser):
    return browser.script(
        "return [...document.querySelectorAll('#rows tr')].map((r) => r.dataset.name)"
    )


def is_read(browser):
    """Whether all four files are listed, and not by their names alone."""
    shown = browser.text("rows") + browser.text("count")
    return len(names(browser)) == 4 and "being read" not in shown and "reading" not in shown


def draws(browser, name):
    view = "return document.getElementById('view').textContent"
    browser.until(lambda: name in browser.script(view), limit_s=30.0)


@pytest.mark.whole
@needs.chromium
def test_the_list_filters_sorts_draws_steps_and_exports(browser, served, folder, tmp_path):
    browser.open(served)
    browser.until(lambda: is_read(browser))
    assert names(browser)[0] == "below/<b>.mcap"  # the newest
    browser.click("only-faults")
    assert names(browser) == ["below/<b>.mcap"]
    browser.click("only-faults")
    browser.press("/", "FLIGHT1")
    browser.until(lambda: names(browser) == ["flight1.mcap"])
    assert browser.text("count") == "1 of 4 flights"
    browser.press(*7 * ["\ue003"])  # backspace
    browser.until(lambda: len(names(browser)) == 4)
    by_tracking = "document.querySelectorAll('#heads button')[2].click()"
    browser.script(by_tracking)  # the largest first
    rows = {row["name"]: row.get("tracking_mm") or 0.0 for row in Index(folder).rows()}
    assert names(browser) == sorted(rows, key=lambda name: -rows[name])
    browser.script("document.querySelector('[data-name=\"below/<b>.mcap\"]').click()")
    draws(browser, "below/<b>.mcap")
    browser.script("document.querySelector('[data-name=\"flight1.mcap\"] input').click()")
    draws(browser, "flight1.mcap")
    browser.until(lambda: np.ptp(browser.script(EDGES), axis=0).max() < 1.0)  # one axis of time
    what = "return document.querySelector('.what').textContent"
    assert browser.script(what) == "3 faults."
    browser.script("document.querySelectorAll('.steps button')[1].click()")
    assert browser.script(what).startswith("1 of 3, 3.1")
    browser.script("document.querySelectorAll('.steps button')[1].click()")
    assert browser.script(what).startswith("2 of 3, 4.")

    client = Client(served)
    token = {"Authorization": f"Bearer {client.token}"}
    path = "/api/export?name=below/%3Cb%3E.mcap&name=flight1.mcap"
    status, headers, page = client.ask("GET", path, **token)
    assert status == 200
    assert "attachment" in headers["Content-Disposition"]
    assert "Permission is hereby granted" in page  # uPlot's licence goes with it
    sent = tmp_path / "sent.html"
    sent.write_text(page, "utf-8")
    browser.open(sent.as_uri(), PHONE, "dark")
    draws(browser, "below/<b>.mcap")
    browser.until(lambda: browser.script("return document.querySelectorAll('.uplot').length") >= 3)
    assert browser.script("return document.documentElement.scrollWidth") <= PHONE[0]


MANY = 10_000
COUNTED = """
window.redrawn = 0;
new MutationObserver((changes) => {
  for (const change of changes) window.redrawn += change.addedNodes.length;
}).observe(document.getElementById("rows"), { childList: true });
"""


@pytest.fixture(scope="module")
def many(folder, tmp_path_factory):
    """Ten thousand flights, all one file; the cache has their numbers, as if they had been read."""
    made = tmp_path_factory.mktemp("many")
    status = (folder / "flight0.mcap").stat()
    row = row_of(folder / "flight0.mcap")
    rows = {}
    for number in range(MANY):
        name = f"{number:05}.mcap"
        os.link(folder / "flight0.mcap", made / name)
        told = row | {"tracking_mm": float(number), "rig": "", "package": "abcdefg"[number % 7]}
        rows[name] = [status.st_size, status.st_mtime_ns, told]
    cache_file(made).parent.mkdir(parents=True, exist_ok=True)
    cache_file(made).write_text(json.dumps({"version": module.VERSION, "logs": rows}))
    return made


def redrawn(browser):
    """How many rows were put into the table since the last time."""
    return browser.script("const told = redrawn; redrawn = 0; return told;")


@pytest.mark.whole
@needs.chromium
def test_of_ten_thousand_flights_a_key_redraws_only_what_is_in_view(browser, many):
    with serving("log", "browse", many) as url:
        browser.open(url)
        browser.until(lambda: browser.text("count") == f"{MANY} flights")
        most = 60  # in view, and a little above and below
        assert len(names(browser)) <= most
        browser.script(COUNTED)
        browser.press("/")
        for typed, count in (("9", 3439), ("9", 280), ("8", 20)):
            browser.press(typed)
            browser.until(lambda count=count: browser.text("count") == f"{count} of {MANY} flights")
            assert redrawn(browser) <= most
        told = [f"{number:05}.mcap" for number in range(MANY) if "998" in f"{number:05}"]
        assert names(browser) == told
        browser.press("6")  # of those in view one stays, and is not drawn again
        browser.until(lambda: names(browser) == ["09986.mcap"])
        assert redrawn(browser) == 0


ROWS = """
return [document.querySelector(".rows table").getAttribute("aria-rowcount"),
  ...[...document.querySelectorAll("#rows tr")].map((row) => row.getAttribute("aria-rowindex"))]
  .map(Number);
"""
IN_VIEW = """
const box = document.querySelector(".rows").getBoundingClientRect();
const top = document.getElementById("heads").getBoundingClientRect().bottom;
return [...document.querySelectorAll("#rows tr")].filter((row) => {
  const at = row.getBoundingClientRect();
  return at.top >= top - 1 && at.bottom <= box.bottom + 1;
}).map((row) => row.dataset.name);
"""
WIDTHS = "return [...document.querySelectorAll('#heads th')].map((head) => head.offsetWidth)"


@pytest.mark.whole
@needs.chromium
def test_a_long_list_scrolls_sorts_and_is_walked_through_by_keys(browser, many):
    with serving("log", "browse", many) as url:
        browser.open(url)
        browser.until(lambda: browser.text("count") == f"{MANY} flights")
        widths = browser.script(WIDTHS)
        browser.script("document.querySelector('#rows input').focus()")
        browser.script("const box = document.querySelector('.rows'); box.scrollTop = 1e9")
        browser.until(lambda: names(browser)[-1] == f"{MANY - 1:05}.mcap")
        total, *places = browser.script(ROWS)
        assert total == MANY + 1
        assert places == list(range(MANY + 2 - len(places), MANY + 2))
        assert browser.script(WIDTHS) == widths
        # The box that had the focus is gone: the list has it, and not nobody.
        assert browser.script("return document.activeElement.className") == "rows"
        browser.script("document.querySelectorAll('#heads button')[2].click()")
        last = [f"{number:05}.mcap" for number in range(MANY - 1, MANY - 31, -1)]
        browser.until(lambda: names(browser)[:20] == last[:20])
        browser.script("document.querySelector('.rows').focus()")
        for name in last:  # farther than was drawn
            browser.press("\ue015")  # arrow down
            browser.until(lambda name=name: name in browser.script(IN_VIEW))
        draws(browser, last[-1])
        chosen = "return document.querySelector('[aria-current]').dataset.name"
        assert browser.script(chosen) == last[-1]


EDGES = (
    "return ['.u-over', '.view-line canvas'].map((one) => document.querySelector(one)"
    ".getBoundingClientRect()).map((r) => [r.left, r.right])"
)


def fits(browser, width):
    """Whether strips and band end at the same places, and fill the window without leaving it."""
    edges = np.array(browser.script(EDGES))
    overflow = browser.script("return document.documentElement.scrollWidth") - width
    return np.ptp(edges, axis=0).max() < 1.0 and edges[0, 1] > 0.8 * width and overflow <= 0


@pytest.mark.whole
@needs.chromium
def test_the_band_of_modes_follows_the_strips_when_the_window_changes(browser, served):
    browser.open(served)
    browser.until(lambda: is_read(browser))
    browser.script("document.querySelector('[data-name=\"flight1.mcap\"]').click()")
    draws(browser, "flight1.mcap")
    for size in (PHONE, (1000, 700), PHONE):
        browser.size(*size)
        browser.until(lambda size=size: fits(browser, size[0]))


@pytest.mark.whole
@needs.chromium
def test_a_phone_scrolls_the_list_and_not_the_page(browser, served):
    browser.open(served, PHONE)
    browser.until(lambda: len(names(browser)) == 4)
    assert browser.script("return document.documentElement.scrollWidth") <= PHONE[0]
    box, tracking = browser.script(
        "return [...document.querySelectorAll('#rows tr:nth-child(1) :is(input, td.is-number)')]"
        ".map((e) => e.getBoundingClientRect()).filter((r) => r.width)"
        ".map((r) => [r.left, r.right])"
    )
    assert 0 <= box[0] < box[1] < tracking[0] < tracking[1] <= PHONE[0]
    assert "Shift" not in browser.driver.find_element("css selector", ".hint").text


@pytest.mark.whole
def test_a_replay_waits_for_the_first_page(folder, monkeypatch):
    clock = [100.0]
    monkeypatch.setattr("wakedeploy.live.replay.time", SimpleNamespace(monotonic=lambda: clock[0]))
    replay = Replay(read_run_log(folder / "flight0.mcap"), "flight0.mcap")
    clock[0] += 60.0
    replay.look()
    assert replay.hub.count <= 1  # the place at which it begins
    replay.visitors.add(Mock(is_let_in=True))
    for _ in range(3):
        replay.look()
        clock[0] += 1.0
    assert 64 <= replay.hub.count <= 66  # two seconds of ticks


@needs.chromium
@pytest.mark.whole
def test_a_replay_plays_pauses_seeks_and_has_no_stop(browser, folder):
    with serving("live", Path(folder) / "flight0.mcap") as url:
        browser.open(url)
        browser.until(lambda: browser.text("t") not in ("–", "0.0"))
        assert not browser.driver.find_element("id", "stop").is_displayed()
        browser.press(" ")
        browser.until(lambda: browser.text("play") == "Play")
        browser.script("wakedeploy.link.send({do: 'seek', value: 6.0})")
        browser.until(lambda: browser.text("t") == "6.0")
        assert browser.script("return wakedeploy.rows().t_s.length") > 150  # and what was before
        browser.script("wakedeploy.link.send({do: 'speed', value: 8})")
        browser.press(" ")
        browser.until(lambda: float(browser.text("t")) > 9.0)
        browser.until(lambda: browser.text("play") == "Play")  # it stops at the log's end
        assert browser.text("budget") == "not measured in simulated time"
        # The last rows are drawn a frame after the button has changed.
        browser.until(lambda: browser.text("line-span") == f"0.0 to {browser.text('t')} s")
