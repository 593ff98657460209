"""A flight as it is flown, for Foxglove: the log's topics over its own protocol.

In: rows of a run log. Out: what subscribers asked for, to read and nothing more: this server takes
no parameter, no message and no service. The protocol knows no token, so only this computer may
reach it. May be imported in the server's own process alone.
"""

import time
from collections.abc import Mapping

from foxglove import Channel, Context, Schema, start_server
from foxglove.websocket import WebSocketServer

from wakedeploy.core.errors import UnusableInput, one_line
from wakedeploy.core.runlog_columns import TOPICS, Value
from wakedeploy.core.runlog_messages import (
    ENCODING,
    SCHEMA_ENCODING,
    json_bytes,
    message_schema,
    schema_name,
    tick_messages,
)
from wakedeploy.live.rows import rounded

LIVE_ONLY = {"/force": {"force_now_n": "N"}}  # numbers of a live tick that no log has, with units


class FoxgloveView:
    """The server, and a channel for each topic; `put` neither waits nor raises."""

    def __init__(self, host: str, port: int) -> None:
        self._context = Context()  # its channels close when nobody has it any more
        self._channels = {topic: _channel(topic, self._context) for topic in TOPICS}
        self._server = _started(host, port, self._context)
        self._start_ns: int | None = None

    @property
    def port(self) -> int:
        """Where it listens."""
        return self._server.port

    def put(self, row: Mapping[str, Value]) -> None:
        """Send one tick to who subscribes. Ticks are stamped by the loop's own clock."""
        t_ns = round(1e9 * float(row["t_s"] or 0.0))
        if self._start_ns is None:
            self._start_ns = time.time_ns() - t_ns
        for topic, values in tick_messages(row):
            for name in LIVE_ONLY.get(topic, ()):
                if (value := rounded(row.get(name), 6)) is not None:
                    values[name] = value
            self._channels[topic].log(json_bytes(values), log_time=self._start_ns + t_ns)

    def stop(self) -> None:
        """Say goodbye to everybody."""
        self._server.stop()


def _channel(topic: str, context: Context) -> Channel:
    described = json_bytes(message_schema(topic, LIVE_ONLY.get(topic)))
    schema = Schema(name=schema_name(topic), encoding=SCHEMA_ENCODING, data=described)
    return Channel(topic, schema=schema, message_encoding=ENCODING, context=context)


def _started(host: str, port: int, context: Context) -> WebSocketServer:
    try:
        return start_server(name="wakedeploy", host=host, port=port, context=context)
    except (RuntimeError, OSError, ValueError) as error:
        raise UnusableInput(
            f"{host}:{port}: Foxglove cannot be served there ({one_line(error)}); end what serves "
            "there, or name another port."
        ) from error
