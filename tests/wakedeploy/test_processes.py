"""Processes that this one starts: what reaches them."""

import subprocess
import sys

# A process of its own, since multiprocessing starts its resource tracker with the first child only.
FIRST_AND_SECOND = """
import multiprocessing, os, signal
from wakedeploy.processes import deaf_to_ctrl_c

def waits(pipe):
    pipe.send("up")
    pipe.recv()
    pipe.send("alive")

def main():
    spawn = multiprocessing.get_context("spawn")
    pairs = [spawn.Pipe() for _ in range(2)]
    members = [spawn.Process(target=waits, args=(theirs,)) for _, theirs in pairs]
    for member in members:
        with deaf_to_ctrl_c():
            member.start()
    for _, theirs in pairs:
        theirs.close()
    for ours, _ in pairs:
        ours.recv()
    heard = []
    signal.signal(signal.SIGINT, lambda *_: heard.append("parent"))
    os.killpg(0, signal.SIGINT)
    for ours, _ in pairs:
        ours.send("go on")
    print(*(ours.recv() for ours, _ in pairs), *heard)
    for member in members:
        member.join()

if __name__ == "__main__":
    main()
"""


def test_ctrl_c_reaches_the_parent_and_none_of_its_processes(tmp_path):
    script = tmp_path / "family.py"
    script.write_text(FIRST_AND_SECOND)
    run = subprocess.run(
        [sys.executable, str(script)],
        capture_output=True, text=True, timeout=120, start_new_session=True,
    )  # fmt: skip
    assert run.stdout == "alive alive parent\n", run.stderr
    assert run.stderr == ""
