"""Pages for people at the rig: a flight as it is flown, a log replayed, a folder of flights.

In: rows of a run log, from the loop's process over a socket (`runtime.io.live_feed`) or from files;
what a person asks for. Out: pages and a websocket, never to anybody without the token. May import
the ground, `runtime` and tornado, inside the server's own process; nothing of it is ever in the
process that flies but `process`, which starts the other one.
"""
