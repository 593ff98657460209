"""The virtual gantry at paths that stay, for whoever opens a port: another program, or a test.

In: the plant's rig, a folder. Out: `uno` and `range.sock` in the folder, until the block ends.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from runtime.virtual.process import VirtualGantryProcess
from wakedeploy.core.errors import UnusableInput
from wakedeploy.core.locks import alone
from wakedeploy.core.rig import Rig

PORT, RANGES = "uno", "range.sock"


@contextlib.contextmanager
def served(
    rig: Rig, folder: Path, *, seed: int = 0, firmware: bool = False
) -> Iterator[VirtualGantryProcess]:
    """A gantry in real time whose port is `folder`/uno, its range sensor `folder`/range.sock.

    The folder is made. Both are links: where the system puts the port has another name each time.
    Raises UnusableInput where another process serves there, where something else has one of the
    names, and for what the gantry cannot use.
    """
    links = (folder / PORT, folder / RANGES)
    with contextlib.ExitStack() as opened:
        opened.enter_context(alone(folder, "Another virtual gantry", "virtual-gantry"))
        for link in links:
            if link.exists() and not link.is_symlink():
                raise UnusableInput(f"{link}: is no link of a virtual gantry; give another --out.")
        gantry = opened.enter_context(
            VirtualGantryProcess(rig, seed=seed, firmware=firmware),
        )
        for link, place in zip(links, (Path(gantry.port), gantry.range_socket), strict=True):
            link.unlink(missing_ok=True)  # of a process that was killed
            link.symlink_to(place)
            opened.callback(link.unlink, missing_ok=True)
        yield gantry
