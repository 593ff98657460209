"""A failing file made small: parts are left out as long as it fails alike."""

from benchmarks.fuzz.judge import Judge, Verdict
from benchmarks.fuzz.kind import Files, Kind

_MOST_TRIES = 400


def smallest(
    judge: Judge, kind: Kind, sound: Files, damaged: dict[str, bytes], verdict: Verdict
) -> dict[str, bytes]:
    """The damaged files without what their failure does not need, after some hundred tries.

    First whole files are put back as they were, then halves, quarters, … of each are left out.
    """
    tries = _MOST_TRIES

    def fails(files: dict[str, bytes]) -> bool:
        nonlocal tries
        tries -= 1
        return judge.judged(kind, sound, files).signature == verdict.signature

    for name in list(damaged):
        without = {n: content for n, content in damaged.items() if n != name}
        if without and fails(without):
            damaged = without
    for name in list(damaged):
        step = len(damaged[name]) // 2
        while step and tries > 0:
            at = 0
            while at < len(damaged[name]) and tries > 0:
                content = damaged[name]
                shorter = {**damaged, name: content[:at] + content[at + step :]}
                if fails(shorter):
                    damaged = shorter
                else:
                    at += step
            step //= 2
    return damaged
