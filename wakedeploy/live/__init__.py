"""Pages for people at the rig: a flight as it is flown, a log replayed, a folder of flights.

In: rows of a run log, from the loop's process over a socket (`runtime.io.live_feed`) or from files;
what a person asks for. Out: pages and a websocket, never to anybody without the token. May import
the ground, `rig`, `runtime`, tornado and foxglove, inside the server's own process. In the process
that flies there is never any of it but `process`, which starts the other one.
"""
