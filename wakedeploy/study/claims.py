"""What the paper claims of each domain, and whether it comes out here.

In: lines of one domain of study 1. Out: for each claim of the paper what is found here and a
verdict that is computed, with no claim left out because it fails.
"""

import tomllib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from wakedeploy.study.domains import (
    MAIN,
    MEMORYLESS,
    SOURCE_ONLY,
    Line,
    by_predictor,
    change,
    errors,
)

PAPER = tomllib.loads(Path(__file__).with_name("paper.toml").read_text(encoding="utf-8"))
RESERVOIR: str = PAPER["reservoir"]
EXPLICIT: list[str] = PAPER["explicit"]
BEST_FOR_SHIPS: str = PAPER["ship"]
PAPER_FISH_R2: dict[str, float] = PAPER["fish_r2"]  # the memoryless, and the best
BEST_FOR_FISH = max(PAPER_FISH_R2, key=lambda name: PAPER_FISH_R2[name])
_ALIKE_R2 = 0.03


def agrees(does: bool) -> str:
    """The verdict in words."""
    return "agrees" if does else "does not agree"


def of_an_order(does: bool, ahead: str, behind: str, lines: Sequence[Line]) -> str:
    """The verdict on an order that hangs on these two predictors: open where they are too alike."""
    trained = by_predictor([line for line in lines if line.seed is not None])
    found = change(trained[ahead], trained[behind])
    if found is not None and found[0] <= 0.0 <= found[1]:
        return f"but these episodes cannot tell {ahead} from {behind}"
    return f"which {agrees(does)}"


def claims(domain: str, lines: Sequence[Line]) -> str:
    """The paper's claims of a domain, with verdicts; empty for one that the paper does not have."""
    claim = _CLAIMS.get(domain)
    mean = {n: v for n, v in errors(lines).items() if not n.endswith(SOURCE_ONLY)}
    if claim is None or MEMORYLESS not in mean or len(mean) < 2:
        return ""
    return claim(mean, lines)


def _quadrotor(mean: Mapping[str, float], lines: Sequence[Line]) -> str:
    plain = mean[MEMORYLESS]
    others = [n for n in mean if n not in (MEMORYLESS, RESERVOIR)]
    sentences = []
    if others:
        better = [n for n in others if mean[n] < plain]
        sentences.append(
            "In the paper all models with memory but the reservoir beat the memoryless: here "
            f"{len(better)} of {len(others)} do, which {agrees(len(better) == len(others))}"
        )
    if RESERVOIR in mean:
        beats = mean[RESERVOIR] < plain
        sentences.append(
            f"the reservoir does not beat it there and {'does' if beats else 'does not'} here, "
            f"which {agrees(not beats)}"
        )
    if set(EXPLICIT) < set(mean):
        two = sorted(mean, key=lambda n: mean[n])[:2]
        verdict = of_an_order(
            set(two) == set(EXPLICIT),
            max(EXPLICIT, key=lambda n: mean[n]),
            min((n for n in mean if n not in EXPLICIT), key=lambda n: mean[n]),
            lines,
        )
        sentences.append(
            f"there Cross-Attention and Delay Embedding are the best two, here {two[0]} and "
            f"{two[1]}, {verdict}"
        )
    authors = (
        "The recordings' authors report z-RMSEs of 1.5 N below, 1.4 N above and 2.7 N swapping for "
        "their memoryless network, on other files of the same kind."
    )
    return f"{_joined(sentences)} {authors}".strip()


def _memory(mean: Mapping[str, float], lines: Sequence[Line]) -> str:
    return _joined([_generally(mean)])


def _generally(mean: Mapping[str, float]) -> str:
    others = {n: v for n, v in mean.items() if n != MEMORYLESS}
    better = sum(v < mean[MEMORYLESS] for v in others.values())
    return (
        "In the paper models with memory generally beat the memoryless: here "
        f"{better} of {len(others)} do, which {agrees(better > len(others) / 2)}"
    )


def _ship(mean: Mapping[str, float], lines: Sequence[Line]) -> str:
    sentences = [_generally(mean)]
    if BEST_FOR_SHIPS in mean:
        least = min(mean, key=lambda n: mean[n])
        other = min((n for n in mean if n != BEST_FOR_SHIPS), key=lambda n: mean[n])
        verdict = of_an_order(least == BEST_FOR_SHIPS, BEST_FOR_SHIPS, other, lines)
        sentences.append(
            f"there History MLP is the best, here {least} errs least on test episodes, {verdict}"
        )
    return _joined(sentences)


def _fish(mean: Mapping[str, float], lines: Sequence[Line]) -> str:
    trained = by_predictor([line for line in lines if line.seed is not None])
    sentences = []
    for name, paper in PAPER_FISH_R2.items():
        if name in trained:
            here = fish_r2(trained[name])
            words = "without memory" if name == MEMORYLESS else "for its GRU"
            sentences.append(
                f"the paper has R² {paper:.2f} {words} and {here:.3f} is found here, which "
                f"{agrees(abs(here - paper) <= _ALIKE_R2)} within {_ALIKE_R2:g}"
            )
    least, most = min(mean, key=lambda n: mean[n]), max(mean, key=lambda n: mean[n])
    if set(PAPER_FISH_R2) < set(mean):
        other = min((n for n in mean if n != BEST_FOR_FISH), key=lambda n: mean[n])
        verdict = of_an_order(
            (least, most) == (BEST_FOR_FISH, MEMORYLESS), BEST_FOR_FISH, other, lines
        )
        sentences.append(
            f"there GRU is the best and the memoryless the worst, here {least} and {most} are on "
            f"the test block, {verdict}"
        )
    text = _joined(sentences)
    return text[:1].upper() + text[1:]


def fish_r2(lines: Sequence[Line]) -> float:
    """Mean R² of the flag's tip over one predictor's seeds."""
    names = [c["channel"] for c in lines[0].channels]
    return float(np.mean([line.channels[names.index(MAIN["fish"])]["r2"] for line in lines]))


def _joined(sentences: Sequence[str]) -> str:
    return f"{'; '.join(sentences)}." if sentences else ""


_CLAIMS: Mapping[str, Callable[[Mapping[str, float], Sequence[Line]], str]] = {
    "quadrotor": _quadrotor,
    "ship": _ship,
    "fish": _fish,
    "downwash": _memory,
    "gantry": _memory,
}
