"""The page of a flight in a real browser: it moves, stops, comes back, fits, and can be read."""

import re
import threading
import time

import needs
import pytest
from browser import PHONE, chromium
from pages import Client, begin, fed, flowing, row, slow_flight

from wakedeploy.live.desk import HOLD_S
from wakedeploy.live.process import live_views

pytestmark = needs.chromium
SIDEWAYS = (844, 390)  # a phone


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.fixture
def served():
    with live_views("127.0.0.1:0") as page:
        begin(page.feed)
        yield page


@pytest.fixture(scope="module")
def calm():
    """A page for tests that only look."""
    with live_views("127.0.0.1:0") as page:
        begin(page.feed)
        fed(page.feed, range(40))
        yield page


def shows(browser, name, text):
    browser.until(lambda: browser.text(name) == text)


@pytest.mark.whole
def test_values_move_and_stop_lands_the_sufferer(browser, served):
    """A flight of the loop in simulated time, eight times faster than real; STOP by Esc."""
    browser.open(served.url)
    flown = []
    flying = threading.Thread(target=lambda: flown.append(slow_flight(served.feed)))
    flying.start()
    browser.until(lambda: float(browser.text("t").replace("–", "0")) > 4.0)
    first = {name: browser.text(name) for name in ("t", "z", "p99")}
    assert browser.text("mode-name") == "Flying"
    moved = browser.script(
        "return document.querySelector('.g-body').parentElement.getAttribute('transform')"
    )
    browser.until(lambda: float(browser.text("t")) > float(first["t"]) + 1.0)
    assert browser.text("z") != first["z"]
    assert moved != browser.script(
        "return document.querySelector('.g-body').parentElement.getAttribute('transform')"
    )
    browser.press("\ue00c")  # Esc
    shows(browser, "stop", "STOPPED")
    shows(browser, "mode-name", "Failsafe")
    flying.join(timeout=20.0)
    tally, speeds_mps, z_m = flown[0]
    assert tally.ended == "stopped by hand"
    assert tally.ticks < 32 * 40
    assert abs(z_m) < 0.05
    assert min(speeds_mps) > -1.0
    assert "Stopped by hand" in browser.text("events")
    assert browser.script("return document.getElementById('stop').disabled")
    served.feed.tell({"phase": "ended", "ended": tally.ended})
    shows(browser, "mode-name", "Ended")
    assert "stopped by hand" in browser.text("notice")


@pytest.mark.whole
def test_a_page_comes_back_and_has_every_row_once(browser, served):
    browser.open(served.url)
    fed(served.feed, range(100))
    count = "return wakedeploy.rows().t_s.filter((t) => t !== null).length"
    browser.until(lambda: browser.script("return window.wakedeploy?.rows().t_s?.length") == 100)
    browser.script("wakedeploy.link.socket.close()")
    fed(served.feed, range(100, 140))
    browser.until(lambda: browser.script(count) == 140)
    times = browser.script("return wakedeploy.rows().t_s")
    assert [round(32 * t) for t in times] == list(range(140))
    shows(browser, "link", "connected")


@pytest.mark.whole
def test_a_height_that_nobody_knows_is_not_drawn_where_it_last_was(browser, served):
    place = "return document.querySelector('.g-{}').getBoundingClientRect().{}"
    browser.open(served.url)
    served.feed.put(row(0))
    browser.until(lambda: browser.text("z") == "0")
    assert browser.script(place.format("body", "width")) > 0
    at_first = browser.script(place.format("reference", "top"))
    served.feed.put(row(1, z_est_m=float("nan"), z_ref_m=0.8))
    browser.until(lambda: browser.text("z") == "–")
    browser.until(lambda: browser.script(place.format("reference", "top")) < at_first)
    assert browser.script(place.format("body", "width")) == 0
    assert browser.script(place.format("carriage", "width")) > 0
    served.feed.put(row(2, z_ref_m=None))
    browser.until(lambda: browser.script(place.format("reference", "width")) == 0)
    assert browser.script(place.format("body", "width")) > 0


@pytest.mark.whole
def test_a_stop_that_nobody_answers_says_so(browser):
    with live_views("127.0.0.1:0") as page:
        begin(page.feed)
        browser.open(page.url)
        with flowing(page.feed):
            shows(browser, "mode-name", "Flying")
            browser.script("wakedeploy.link.stop = () => {}")  # what is sent reaches nobody
            browser.click("stop")
            browser.until(lambda: "was not answered" in browser.text("notice"))


@pytest.mark.whole
def test_a_loop_that_does_not_act_on_stop_and_one_that_is_silent_are_told(browser):
    is_grave = "return document.getElementById('notice').classList.contains('is-grave')"
    with live_views("127.0.0.1:0") as page:
        begin(page.feed)
        browser.open(page.url)
        with flowing(page.feed) as values:  # by a loop that does not look for STOP
            shows(browser, "mode-name", "Flying")
            browser.click("stop")
            shows(browser, "stop", "STOP SENT")
            assert "The sufferer comes down" not in browser.text("notice")
            browser.until(lambda: "the loop has not answered: use" in browser.text("notice"))
            assert browser.script(is_grave)
            assert page.feed.stop_asked()
            values |= {"mode": "FAILSAFE", "faults": "operator_stop"}
            shows(browser, "stop", "STOPPED")
            assert "The sufferer comes down" in browser.text("notice")
            assert not browser.script(is_grave)
        shows(browser, "mode-name", "No data")
        assert browser.text("mode-more") == "last: Failsafe"
        assert "what is shown is old" in browser.text("notice")
        assert browser.script(is_grave)
        assert "silent" in browser.text("link")


@pytest.mark.whole
def test_a_run_that_cannot_begin_says_why_and_nothing_of_a_log(browser):
    with live_views("127.0.0.1:0") as page:
        browser.open(page.url)
        shows(browser, "mode-name", "Starting")
        assert browser.text("log") == "–"
        page.feed.tell({"phase": "ended", "reason": "The virtual gantry answered too late."})
        shows(browser, "mode-name", "Ended")
        assert "has ended: The virtual gantry answered too late. What" in browser.text("notice")
        assert browser.text("log") == "–"


@pytest.mark.whole
def test_without_the_token_nothing_is_shown(browser, served):
    browser.open(served.url.partition("#")[0])
    browser.until(lambda: "token is missing or wrong" in browser.text("notice"))
    browser.open(served.url[:-1])
    browser.until(lambda: "token is missing or wrong" in browser.text("notice"))
    assert browser.text("z") == "–"


@pytest.mark.parametrize("size", [PHONE, SIDEWAYS, (667, 375), (768, 1024), (1440, 900)], ids=str)
def test_stop_and_height_are_in_sight_and_nothing_hangs_over(browser, calm, size):
    browser.open(calm.url, size)
    shows(browser, "z", "39")
    assert browser.script("return document.documentElement.scrollWidth") <= size[0]
    for scroll in (0, 400):
        browser.script("window.scrollTo(0, arguments[0])", scroll)
        for name in ("stop", "z", "mode-name"):
            top, bottom, width = browser.script(
                "const r = document.getElementById(arguments[0]).getBoundingClientRect();"
                "return [r.top, r.bottom, r.width]",
                name,
            )
            assert top >= 0
            assert bottom <= size[1]
            assert width > 0
    wide, high = browser.script(
        "const r = document.getElementById('stop').getBoundingClientRect();"
        "return [r.width, r.height]"
    )
    assert wide > (200 if size[1] > 480 else 150)
    assert high >= 48  # a thumb
    top = "return document.querySelector('.top').getBoundingClientRect().height"
    assert browser.script(top) <= 0.25 * size[1]


def test_nothing_moves_while_values_change(browser, served):
    places = (
        "const places = 'main > *, .top > *, .top dd, .facts dd, .columns > *';"
        "return [...document.querySelectorAll(places)].map((e) => e.getBoundingClientRect())"
        ".map((r) => [r.left, r.top, r.right, r.bottom])"
    )
    browser.open(served.url)
    with flowing(served.feed, z_est_m=0.001) as values:
        shows(browser, "z", "1")
        before = browser.script(places)
        values |= {"z_est_m": 1.0, "z_ref_m": -0.1, "battery_v": 11.4, "gap_score": 0.3}
        shows(browser, "z", "1000")
        values |= {"z_est_m": 1.234, "z_ref_m": 0.4}
        values |= {"mode": "DEGRADED", "faults": "late+doubted+range_bad"}
        shows(browser, "z", "1234")
        browser.until(lambda: browser.text("mode-name") == "PID alone")
        assert browser.script(places) == before


def test_the_keyboard_reaches_stop_first_and_shows_where_it_is(browser, served):
    browser.open(served.url)
    fed(served.feed, range(10))
    shows(browser, "z", "9")
    browser.press("\ue004")  # Tab
    assert browser.script("return document.activeElement.id") == "stop"
    assert browser.script("return getComputedStyle(document.activeElement).outlineStyle") == "solid"
    assert browser.script("return document.getElementById('stop').getAttribute('aria-describedby')")
    browser.press(" ")
    browser.until(served.feed.stop_asked)


def test_dark_is_dark_and_is_drawn_anew(browser, calm):
    ground = "return getComputedStyle(document.body).backgroundColor"
    line = "return document.querySelector('#chart-height .uplot') !== null"
    browser.open(calm.url)
    browser.until(lambda: browser.script(line))
    light = browser.script(ground)
    browser.open(calm.url, scheme="dark")
    browser.until(lambda: browser.script(line))
    dark = browser.script(ground)
    assert sum(map(int, re.findall(r"\d+", light)[:3])) > 700
    assert sum(map(int, re.findall(r"\d+", dark)[:3])) < 100


@pytest.mark.wallclock
def test_two_steps_arm_and_a_page_that_goes_lands_the_flight(browser, tmp_path):
    word = tmp_path / "fly"
    with live_views("127.0.0.1:0") as page:
        browser.open(page.url)
        page.feed.tell({"phase": "standby", "arm_file": str(word), "title": "x"})
        shows(browser, "mode-name", "Standing by")
        browser.click("arm")
        assert browser.script("return document.activeElement.id") == "arm-no"
        browser.until(lambda: browser.script("return !document.getElementById('arm-yes').disabled"))
        assert not word.exists()
        browser.click("arm-yes")
        browser.until(word.exists)
        time.sleep(HOLD_S + 0.5)  # a package is tried meanwhile; the page is heard without rows
        assert not page.feed.stop_asked()
        begin(page.feed)
        fed(page.feed, range(160), 0.03)  # and with them
        assert not page.feed.stop_asked()
        browser.driver.get("about:blank")
        browser.until(page.feed.stop_asked, limit_s=HOLD_S + 3.0)


@pytest.mark.wallclock
def test_ten_browsers_pages_and_the_loop_loses_nothing(browser, served):
    """Ten tabs of one browser."""
    tabs = [browser.driver.current_window_handle]
    browser.open(served.url)
    for _ in range(9):
        browser.driver.switch_to.new_window("tab")
        browser.driver.get(served.url)
        tabs.append(browser.driver.current_window_handle)
    client = Client(served.url)
    assert client.ask("GET", "/")[0] == 200
    browser.until(lambda: browser.script("return window.wakedeploy?.state().pages") == 10)
    fed(served.feed, range(64), 0.01)
    for tab in tabs:
        browser.driver.switch_to.window(tab)
        browser.until(lambda: browser.script("return wakedeploy.rows().t_s.length") == 64)
    for tab in tabs[1:]:
        browser.driver.switch_to.window(tab)
        browser.driver.close()
    browser.driver.switch_to.window(tabs[0])
    assert served.feed.dropped == 0
