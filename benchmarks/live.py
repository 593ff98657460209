"""What a live page costs the loop: flights with ten pages open, each paired with one without any.

Every flight is one of the virtual gantry in real time, paced at 32 Hz, of the same plan; the order
within a pair alternates. Pages are read by another process, as by ten browsers. What a row costs
in the loop, and how long `log browse` takes to list a thousand flights, is timed beside it.

    python -m benchmarks.live --json docs/records/live.json
"""

import argparse
import asyncio
import contextlib
import json
import math
import multiprocessing
import os
import shutil
import socket
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import tornado.httpclient
import tornado.websocket

from benchmarks import records
from runtime.io.live_feed import LiveFeed
from runtime.loop.tally import Tally
from runtime.request import RunRequest
from runtime.run import fly
from wakedeploy.core.errors import CheckFailed
from wakedeploy.live.flights import Index
from wakedeploy.live.process import live_views
from wakedeploy.rig.file import default_rig

PAGES = 10
ROWS = 20_000  # whose hand-over is timed


def main() -> None:
    """Fly the pairs, time the rest, print and write."""
    options = _options()
    flown = [_pair(number, options) for number in range(options.pairs)]
    result = {
        "pages": PAGES,
        "seconds": options.seconds,
        "package": options.package.name if options.package else None,
        "pairs": flown,
        "put_us": _put_us(),
        "list": _listed(options.logs),
    } | _difference(flown)
    print(json.dumps(result, indent=1))
    if options.json:
        records.write(options.json, result)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--package", type=Path, help="feed its force forward; default: PID alone")
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--logs", type=int, default=1000, help="of the folder that is listed")
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def _pair(number: int, options: argparse.Namespace) -> dict[str, Any]:
    order = (0, PAGES) if number % 2 == 0 else (PAGES, 0)
    by_pages = {f"{pages}": _flown(pages, number, options) for pages in order}
    print(f"pair {number + 1} of {options.pairs}: {by_pages}", file=sys.stderr, flush=True)
    return by_pages


def _flown(pages: int, seed: int, options: argparse.Namespace) -> dict[str, Any]:
    """A flight's latency [ms] and how late its ticks began, with `pages` pages open."""
    request = RunRequest(
        default_rig(), options.seconds, seed=seed, wall_clock=True, package=options.package
    )
    tallies: list[Tally] = []
    with contextlib.ExitStack() as opened:
        feed = opened.enter_context(_read_by(pages)) if pages else None
        try:
            fly(request, tell=tallies.append, live=feed)
        except CheckFailed as error:
            print(error, file=sys.stderr)
        dropped = feed.dropped if feed else 0
    (tally,) = tallies
    return {"ended": tally.ended, "ticks": tally.ticks, "overruns": tally.overruns} | {
        "dropped": dropped,
        "compute_ms": _spread(tally.totals_s),
        "wake_up_ms": _spread(np.asarray(tally.wake_ups_s)),
    }


def _spread(values_s: Any) -> dict[str, float]:
    named = zip(("p50", "p99", "p999", "max"), (50, 99, 99.9, 100), strict=True)
    return {name: round(1e3 * float(np.percentile(values_s, at)), 4) for name, at in named}


@contextlib.contextmanager
def _read_by(pages: int) -> Iterator[LiveFeed]:
    """A live page with `pages` readers, in a process of their own."""
    with live_views("127.0.0.1:0") as page:
        context = multiprocessing.get_context("spawn")
        ready = context.Event()
        readers = context.Process(target=_read, args=(page.url, pages, ready), daemon=True)
        readers.start()
        if not ready.wait(30.0):
            raise RuntimeError("the pages' readers did not begin")
        try:
            yield page.feed
        finally:
            readers.terminate()
            readers.join()


def _read(url: str, pages: int, ready: Any) -> None:
    async def open_page() -> Any:
        parts = urlsplit(url)
        headers = {"Origin": f"http://{parts.netloc}"}
        request = tornado.httpclient.HTTPRequest(f"ws://{parts.netloc}/live", headers=headers)
        opened = await tornado.websocket.websocket_connect(request)
        await opened.write_message(json.dumps({"token": parts.fragment}))
        return opened

    async def all_of_them() -> None:
        opened = await asyncio.gather(*(open_page() for _ in range(pages)))
        ready.set()
        await asyncio.gather(*(_until_closed(page) for page in opened))

    asyncio.run(all_of_them())


async def _until_closed(page: Any) -> None:
    while (message := await page.read_message()) is not None:
        json.loads(message)


def _difference(flown: list[dict[str, Any]]) -> dict[str, Any]:
    """What the pages add to each quantile [ms]: the mean over pairs, and its standard error."""
    result: dict[str, Any] = {}
    for series in ("compute_ms", "wake_up_ms"):
        result[f"added_{series}"] = {
            name: _mean(
                [pair[f"{PAGES}"][series][name] - pair["0"][series][name] for pair in flown]
            )
            for name in ("p50", "p99", "p999", "max")
        }
    return result


def _mean(values: list[float]) -> list[float | None]:
    error = statistics.stdev(values) / math.sqrt(len(values)) if len(values) > 1 else None
    return [round(statistics.fmean(values), 4), None if error is None else round(error, 4)]


def _listed(logs: int) -> dict[str, float]:
    """How long a list of `logs` flights takes [s]: read from the files, and from the cache."""
    with tempfile.TemporaryDirectory() as temporary, _cache_in(Path(temporary)):
        folder = Path(temporary) / "flights"
        folder.mkdir()
        first = folder / "0.mcap"
        fly(RunRequest(default_rig(), 20.0, log=first))
        for number in range(1, logs):
            shutil.copyfile(first, folder / f"{number}.mcap")
        began_s = time.perf_counter()
        Index(folder).refresh()
        read_s = time.perf_counter() - began_s
        began_s = time.perf_counter()
        rows = Index(folder).rows()
        from_cache_s = time.perf_counter() - began_s
        assert len(rows) == logs
        assert not any("waits" in row for row in rows)
    return {"logs": logs, "read_s": round(read_s, 2), "from_cache_s": round(from_cache_s, 4)}


@contextlib.contextmanager
def _cache_in(folder: Path) -> Iterator[None]:
    """A cache of its own, gone afterwards."""
    before = os.environ.get("XDG_CACHE_HOME")
    os.environ["XDG_CACHE_HOME"] = str(folder / "cache")
    try:
        yield
    finally:
        if before is None:
            del os.environ["XDG_CACHE_HOME"]
        else:
            os.environ["XDG_CACHE_HOME"] = before


def _put_us() -> dict[str, float]:
    """What handing over one row takes in the loop's thread [µs], to a process that reads."""
    from wakedeploy.core.runlog import read_run_log

    with tempfile.TemporaryDirectory() as folder:
        log = Path(folder) / "flight.mcap"
        fly(RunRequest(default_rig(), 6.0, log=log))
        rows = list(read_run_log(log).rows())
    ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    feed, took_s = LiveFeed(ours), []
    for number in range(ROWS):
        began_s = time.perf_counter()
        feed.put(rows[number % len(rows)])
        took_s.append(time.perf_counter() - began_s)
        its.recv(65536)
    feed.close()
    its.close()
    return {
        k: round(1e6 * float(np.percentile(took_s, at)), 1)
        for k, at in (("p50", 50), ("p999", 99.9))
    }


if __name__ == "__main__":
    main()
