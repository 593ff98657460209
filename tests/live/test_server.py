"""A page's server in its own process: what it sends, to whom, how much, and what it passes on."""

import asyncio
import json
import threading
import time

import pytest
import tornado.httpclient
from pages import Client, Slow, begin, fed, row, rows_until, sent_at, slow_flight

from wakedeploy.core.errors import UnusableInput
from wakedeploy.live.process import live_views


@pytest.fixture(scope="module")
def served():
    """One page for the tests that leave it as it is."""
    with live_views("127.0.0.1:0") as page:
        begin(page.feed)
        yield page


@pytest.fixture(scope="module")
def client(served):
    return Client(served.url)


def test_the_page_is_sent_with_headers_that_leave_nothing_open(client):
    status, headers, body = client.ask("GET", "/")
    assert status == 200
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "<script>" not in body
    assert " style=" not in body
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["X-Frame-Options"] == "DENY"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert "Tornado" not in str(headers)


@pytest.mark.parametrize(
    "path", ["/static/../web.py", "/static/%2e%2e/web.py", "/x", "/static/x.js"]
)
def test_nothing_but_the_pages_files_is_sent(client, path):
    status, headers, _ = client.ask("GET", path)
    assert status == 404
    assert "Content-Security-Policy" in headers


def test_another_host_is_refused(client):
    assert client.ask("GET", "/", Host="evil.example")[0] == 421


@pytest.mark.parametrize(
    ("method", "headers", "status"),
    [
        ("GET", {"Origin": "OURS", "Authorization": "Bearer TOKEN"}, 405),
        ("POST", {"Authorization": "Bearer TOKEN"}, 403),
        ("POST", {"Origin": "http://evil.example", "Authorization": "Bearer TOKEN"}, 403),
        ("POST", {"Origin": "OURS"}, 401),
        ("POST", {"Origin": "OURS", "Authorization": "Bearer wrong"}, 401),
    ],
)
def test_nobody_else_stops_a_flight_and_no_get_does(served, client, method, headers, status):
    known = {"OURS": f"http://{client.host}", "Bearer TOKEN": f"Bearer {client.token}"}
    given = {name: known.get(value, value) for name, value in headers.items()}
    assert client.ask(method, "/stop", **given)[0] == status
    assert not served.feed.stop_asked()


def test_a_page_without_the_token_or_from_elsewhere_sees_nothing(client):
    async def visit():
        stranger = await client.page(token="wrong")
        assert await stranger.read_message() is None
        assert stranger.close_code == 4401
        with pytest.raises(tornado.httpclient.HTTPClientError, match="403"):
            await client.page(origin="http://evil.example")

    asyncio.run(visit())


def test_who_talks_too_much_is_sent_away(client):
    async def visit():
        page = await client.page()
        for _ in range(60):
            page.write_message(json.dumps({"do": "beat"}))
        while await page.read_message() is not None:
            pass
        assert page.close_code == 4429

    asyncio.run(visit())


@pytest.mark.parametrize("said", ["no JSON", "[1]", '{"token": 7}'])
def test_what_is_no_token_is_no_error(client, said):
    async def visit():
        request = tornado.httpclient.HTTPRequest(
            f"ws://{client.host}/live", headers={"Origin": f"http://{client.host}"}
        )
        page = await tornado.websocket.websocket_connect(request)
        await page.write_message(said)
        assert await page.read_message() is None
        assert page.close_code in (4400, 4401)

    asyncio.run(visit())


@pytest.mark.whole
def test_ten_pages_get_every_row_once_and_one_that_comes_back_only_the_rest():
    with live_views("127.0.0.1:0") as page:
        client = Client(page.url)
        begin(page.feed)

        async def visit():
            pages = [await client.page() for _ in range(10)]
            feeding = threading.Thread(target=fed, args=(page.feed, range(200)))
            feeding.start()
            for one in pages:
                frames = await rows_until(one, 199)
                ticks = [round(32 * r[0]) for frame in frames for r in frame.get("rows", ())]
                assert ticks == list(range(200))
            feeding.join()
            last = frames[-1]
            pages[0].close()
            fed(page.feed, range(200, 240))
            again = await client.page(seen=last["seen"], epoch=last["epoch"])
            frames = await rows_until(again, 239)
            ticks = [round(32 * r[0]) for frame in frames for r in frame.get("rows", ())]
            assert ticks == list(range(200, 240))

        asyncio.run(visit())


@pytest.mark.whole
def test_a_page_is_asked_whether_it_is_there_while_rows_flow_and_while_none_do():
    with live_views("127.0.0.1:0") as page:
        begin(page.feed)

        async def asked(socket, for_s):
            """How often within a time."""
            count = 0
            try:
                async with asyncio.timeout(for_s):
                    while message := await socket.read_message():
                        count += "there" in json.loads(message)
            except TimeoutError:
                return count
            raise AssertionError("the page was sent away")

        async def visit():
            one = await Client(page.url).page()
            flowing = threading.Thread(target=fed, args=(page.feed, range(300), 0.006))
            flowing.start()
            assert await asked(one, 1.8) >= 2  # HOLD_S is longer
            flowing.join()
            assert await asked(one, 1.8) >= 2

        asyncio.run(visit())


@pytest.mark.whole
def test_a_page_that_does_not_read_holds_up_nobody_and_misses_what_it_did_not_take():
    """Twice what fits between the two, while it does not read; then it gets the newest."""
    with live_views("127.0.0.1:0") as page:
        client = Client(page.url)
        begin(page.feed)

        slow = Slow(client)

        async def visit():
            quick = await client.page()
            await asyncio.to_thread(fed, page.feed, range(6000), 0.0001)
            await rows_until(quick, 5999)

        asyncio.run(visit())
        rows, newest = 0, -1.0
        while newest < 5999 / 32 - 1e-3:
            frame = {"rows": []} | slow.read()
            rows += len(frame["rows"])
            newest = frame["rows"][-1][0] if frame["rows"] else newest
        assert 100 < rows < 5000


@pytest.mark.whole
def test_stop_by_request_lands_a_flight_gently():
    with live_views("127.0.0.1:0") as page:
        client = Client(page.url)
        headers = {"Origin": f"http://{client.host}", "Authorization": f"Bearer {client.token}"}

        def stop():
            time.sleep(0.8)
            assert client.ask("POST", "/stop", **headers)[0] == 200

        pressing = threading.Thread(target=stop)
        pressing.start()
        tally, speeds_mps, z_m = slow_flight(page.feed)
        pressing.join()
    assert tally.ended == "stopped by hand"
    assert tally.ticks > 60
    assert abs(z_m) < 0.05
    assert min(speeds_mps) > -1.0


def test_a_stop_after_the_run_or_a_second_page_at_a_port_is_a_sentence(client):
    with pytest.raises(UnusableInput, match="no page can be served there"), live_views(client.host):
        pass


@pytest.mark.whole
def test_a_socket_in_the_file_system_is_this_users_alone(tmp_path):
    path = tmp_path / "live"
    with live_views(str(path)) as page:
        assert "ssh -N -L 8032:" in page.url
        assert path.stat().st_mode & 0o077 == 0
        assert "<title>wakedeploy</title>" in sent_at(path)
    assert not path.exists()


def test_pages_hear_how_a_run_ended_before_the_server_goes():
    async def visit(client, page):
        one = await client.page()
        page.feed.put(row(1))
        await rows_until(one, 1)
        page.feed.tell({"phase": "ended", "ended": "whole"})
        page.feed.close()
        state = {}
        while (message := await one.read_message()) is not None:
            state |= json.loads(message).get("state", {})
        assert (state["phase"], state["ended"]) == ("ended", "whole")
        assert one.close_code == 4000

    with live_views("127.0.0.1:0") as page:
        asyncio.run(visit(Client(page.url), page))
