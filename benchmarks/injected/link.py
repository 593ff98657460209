"""The wire between computer and board: cut, lossy, late, damaged, or gone."""

from collections.abc import Callable
from functools import partial

from benchmarks.injected.fault import Fault, Scene
from benchmarks.injected.world import Delayed

GROUP = "link"
WAYS = {"commands": "to_board", "answers": "to_host"}

Carry = Callable[[bytes], Delayed]


def carries(scene: Scene, *ways: str, by: Carry) -> None:
    """Bytes pass these ways otherwise."""
    for way in ways:
        setattr(scene.world.board, way, by)


def cut(scene: Scene) -> None:
    """No byte passes."""
    carries(scene, *WAYS.values(), by=lambda data: [])


def loses(scene: Scene, *, way: str, share: float) -> None:
    """So many frames are lost."""
    carries(scene, way, by=lambda data: [] if scene.rng.random() < share else [(0.0, data)])


def late(scene: Scene, *, way: str, seconds: float) -> None:
    """Every frame is late."""
    carries(scene, way, by=lambda data: [(seconds, data)])


def damages(scene: Scene, *, share: float) -> None:
    """So many bytes become others."""

    def damaged(data: bytes) -> Delayed:
        hit = scene.rng.random(len(data)) < share
        others = scene.rng.integers(0, 256, len(data))
        return [(0.0, bytes(int(o) if h else b for b, h, o in zip(data, hit, others, strict=True)))]

    carries(scene, *WAYS.values(), by=damaged)


def doubles(scene: Scene) -> None:
    """Every frame comes twice."""
    carries(scene, *WAYS.values(), by=lambda data: [(0.0, data), (0.0, data)])


def reorders(scene: Scene, *, way: str) -> None:
    """Swap every two frames: the second comes first."""
    kept: list[bytes] = []

    def swapped(data: bytes) -> Delayed:
        if not kept:
            kept.append(data)
            return []
        return [(0.0, data), (0.0, kept.pop())]

    carries(scene, way, by=swapped)


def breaks(scene: Scene) -> None:
    """The port is gone, and the board hears nothing more."""
    cut(scene)
    scene.world.break_port()


def _fault(name: str, sentence: str, begin: Callable[[Scene], None], obeys: bool = True) -> Fault:
    return Fault(name, sentence, GROUP, begin, obeys=obeys)


_CUT = _fault("link cut", "No byte passes between computer and board.", cut, obeys=False)
FAULTS = (
    _CUT,
    *(_CUT.for_a_time(seconds) for seconds in (0.1, 0.2, 0.5, 1.0)),
    *(
        _fault(f"{percent} % of {way} lost", f"{percent} % of the {way} are lost.",
               partial(loses, way=WAYS[way], share=0.01 * percent))
        for way, percents in (("commands", (30, 50, 80)), ("answers", (30, 50, 80, 100)))
        for percent in percents
    ),
    *(
        _fault(f"{way} {ms} ms late", f"The {way} are {ms} ms late.",
               partial(late, way=WAYS[way], seconds=1e-3 * ms))
        for way, times in (("commands", (40, 60, 100, 200)), ("answers", (40, 100)))
        for ms in times
    ),
    *(
        _fault(f"{percent} % of bytes damaged", f"{percent} % of all bytes become others.",
               partial(damages, share=0.01 * percent))
        for percent in (1, 10, 50)
    ),
    _fault("frames doubled", "Every frame comes twice, both ways.", doubles),
    *(
        _fault(f"{way} reordered", f"Of two {way} the second comes first.",
               partial(reorders, way=WAYS[way]))
        for way in WAYS
    ),
    _fault("port gone", "The port is gone, as after a pulled cable.", breaks, obeys=False),
)  # fmt: skip
