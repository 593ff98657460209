"""A client of Foxglove's protocol gets topics, schemas and ticks, and has no way to change them."""

import asyncio
import json
import re
import struct

import jsonschema
import pytest
import tornado.websocket
from click.testing import CliRunner
from pages import fed, row

from wakedeploy.cli import main
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.runlog_columns import TOPICS
from wakedeploy.live.foxglove_layout import LAYOUT, layout_text
from wakedeploy.live.process import live_views

SUBPROTOCOL = "foxglove.sdk.v1"
FLY = ["run-gantry", "--baseline", "--virtual"]


@pytest.fixture(scope="module")
def served():
    with live_views(None, "127.0.0.1:0") as views:
        yield views


async def told(url, feed, ticks):
    """What the server says of itself, its channels, and the messages that follow some rows."""
    client = await tornado.websocket.websocket_connect(url, subprotocols=[SUBPROTOCOL])
    info, channels = {}, {}
    while not info or len(channels) < len(TOPICS):
        message = json.loads(await client.read_message())
        if message["op"] == "serverInfo":
            info = message
        for channel in message.get("channels", ()):
            channels[channel["id"]] = channel
    wanted = [{"id": number, "channelId": number} for number in channels]
    await client.write_message(json.dumps({"op": "subscribe", "subscriptions": wanted}))
    await asyncio.sleep(0.2)
    fed(feed, ticks)
    heard = []
    while len({stamp for _, stamp, _ in heard}) < len(ticks) or heard[-1][0] != "/state":
        data = await asyncio.wait_for(client.read_message(), 5.0)
        if isinstance(data, bytes):
            kind, number, stamp = struct.unpack_from("<BIQ", data)
            assert kind == 1
            heard.append((channels[number]["topic"], stamp, json.loads(data[13:])))
    client.close()
    return info, list(channels.values()), heard


def test_a_client_gets_every_topic_with_its_schema_and_the_ticks_in_it(served):
    ticks = range(10, 20)
    info, channels, heard = asyncio.run(told(served.foxglove, served.feed, ticks))
    assert info["capabilities"] == []  # nothing can be asked for
    schemas = {channel["topic"]: json.loads(channel["schema"]) for channel in channels}
    assert set(schemas) == set(TOPICS)
    assert all(channel["encoding"] == "json" for channel in channels)
    for topic, _, values in heard:
        jsonschema.validate(values, schemas[topic])
        assert set(values) <= set(schemas[topic]["properties"])
    states = [(stamp, values) for topic, stamp, values in heard if topic == "/state"]
    assert [values["tick"] for _, values in states] == list(ticks)
    assert [stamp - states[0][0] for stamp, _ in states] == [n * 31_250_000 for n in range(10)]
    forces = [values for topic, _, values in heard if topic == "/force"]
    assert forces[0] == {"force_pred_n": row(10)["force_pred_n"], "force_now_n": -0.6}


def test_only_this_computer_may_be_named(served):
    for address in ("0.0.0.0:8765", "/run/foxglove"):
        with pytest.raises(UnusableInput, match="served without a token"):
            live_views(None, address).__enter__()
    with pytest.raises(UnusableInput, match="Foxglove cannot be served there"):
        live_views(None, served.foxglove.removeprefix("ws://")).__enter__()
    asked = CliRunner().invoke(main, [*FLY, "--foxglove", "--flights", "2"])
    assert "--foxglove shows a single flight" in asked.output


def test_the_layout_is_what_the_library_makes_and_shows_columns_that_there_are():
    text = LAYOUT.read_text("utf-8")
    assert text == layout_text()
    paths = re.findall(r'"value": "(/\w+)\.(\w+)"', text)
    assert len(paths) > 15
    live_only = {("/force", "force_now_n")}
    assert {(t, c) for t, c in paths if c not in TOPICS[t]} == live_only
