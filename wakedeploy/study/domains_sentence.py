"""What the lines of study 1 say, in words that are true whichever way they come out.

In: lines of one domain. Out: a few sentences. Which model is the best is decided on validation
episodes; whether it is any good, on test episodes.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from wakedeploy.study.claims import claims
from wakedeploy.study.domains import (
    MAIN,
    MEMORYLESS,
    SOURCE_ONLY,
    ZERO,
    Line,
    by_predictor,
    change,
    errors,
    held_out,
    r2_over_seeds,
)

_MEASURED = {"crazyflie": "On air that was really measured, "}


def sentence(domain: str, lines: Sequence[Line]) -> str:
    """What a domain's lines say, and the paper's claims beside them."""
    trained = by_predictor([line for line in lines if line.seed is not None])
    mean, validation = errors(lines), held_out(lines)
    kept = {n: mean.pop(n) for n in list(mean) if n.endswith(SOURCE_ONLY)}
    if MEMORYLESS not in mean or len(mean) < 2:
        trained_here = "architecture was" if len(mean) == 1 else "architectures were"
        return f"On {domain}, {len(mean)} {trained_here} trained."
    best = min(mean, key=lambda name: validation[name])
    text = f"On {domain}, {best} is the best on validation. {_compared(domain, best, lines)}"
    zero = min((x.error for x in lines if x.predictor == ZERO), default=1.0)
    if mean[best] >= min(zero, 1.0):
        text += " It predicts no better than a constant would: nothing was learned that holds."
    if kept:
        name = min(kept, key=lambda kept_name: validation[kept_name])
        text += f" {_of_the_source(trained[name][0], kept[name], mean[best], mean[MEMORYLESS])}"
    return " ".join(filter(None, (text, claims(domain, lines))))


def headline(by_domain: Mapping[str, Sequence[Line]]) -> str:
    """Over all domains: where memory helps, and by how much it changes the error."""
    changes = {}
    for domain, lines in by_domain.items():
        mean, validation = errors(lines), held_out(lines)
        models = [n for n in validation if not n.endswith(SOURCE_ONLY)]
        memories = [n for n in models if n != MEMORYLESS]
        if MEMORYLESS in mean and memories:
            best = min(memories, key=lambda name: validation[name])
            changes[domain] = mean[best] / mean[MEMORYLESS] - 1.0
    if not changes:
        return ""
    shares = ", ".join(f"{100 * c:+.0f} % on {domain}" for domain, c in changes.items())
    helps = sum(c < 0.0 for c in changes.values())
    return (
        f"In {helps} of {len(changes)} domains the memory that is best on validation errs less on "
        f"test episodes than the model without ({shares}). "
    )


def _compared(domain: str, best: str, lines: Sequence[Line]) -> str:
    """How the best on validation, and all models with memory, compare with the memoryless."""
    mean = {n: v for n, v in errors(lines).items() if not n.endswith(SOURCE_ONLY)}
    plain = mean.pop(MEMORYLESS)
    better = sum(value < plain for value in mean.values())
    count = f"{better} of {len(mean)} models with memory err less than the one without"
    trained = by_predictor(lines)
    if best == MEMORYLESS:
        least = min(mean, key=lambda name: mean[name])
        return (
            f"It has no memory; on test episodes it has {_level(trained[best])}, and {count} (the "
            f"least, {least}, has {_level(trained[least])})."
        )
    return (
        f"On test episodes it has {_level(trained[best])}, against {_level(trained[MEMORYLESS])} "
        f"without memory; {count}. {_helps(domain, best, lines)}"
    )


def _level(lines: Sequence[Line]) -> str:
    """How good one predictor's lines are: of the fish R², as the paper has it, else the error."""
    domain = lines[0].domain
    if domain == "fish":
        return f"R² {r2_over_seeds(lines, lines[0].main_channels[0]).text} of {MAIN[domain]}"
    of = f"{MAIN[domain]}'s" if domain in MAIN else "the force's"
    return f"an error of {np.mean([line.error for line in lines]):.2f} of {of} standard deviation"


def _helps(domain: str, best: str, lines: Sequence[Line]) -> str:
    """Whether memory took anything off the error, and whether the test episodes can tell."""
    trained = by_predictor(lines)
    mean = errors(lines)
    share = mean[best] / mean[MEMORYLESS] - 1.0
    does = "takes" if share < 0.0 else "adds"
    effect = f"{does} {100 * abs(share):.0f} % {'off' if share < 0.0 else 'to'} the error"
    found = change(trained[best], trained[MEMORYLESS])
    if found is None:
        sure = "there are too few test episodes for an interval"
    else:
        sure = f"90 % interval {100 * found[0]:+.0f} to {100 * found[1]:+.0f} %"
        if found[0] <= 0.0 <= found[1]:
            sure += ", so that these episodes cannot tell whether memory helps"
    text = f"{_MEASURED.get(domain, '')}memory {effect} ({sure})."
    return text[0].upper() + text[1:]


def _of_the_source(line: Line, kept: float, best: float, plain: float) -> str:
    """How much of memory's gain is there without any past of the sufferer's place and motion."""
    hidden = line.wanted.present_only if line.wanted is not None else ()
    seen = [name for name in line.inputs if name not in hidden]
    channels = f" (they see the past of {len(seen)} of {len(line.inputs)} channels" if seen else ""
    named = f"{channels}: {', '.join(seen)})" if channels else ""
    text = (
        "Of the variants kept from the past of all that the sufferer's own motion enters, its "
        f"place beside the source included{named}, {line.predictor.removesuffix(SOURCE_ONLY)} is "
        f"the best on validation and errs by {kept:.2f}"
    )
    if best >= plain:
        return f"{text}."
    if kept >= plain:
        return f"{text}, no less than without memory: nothing of what memory gains is left."
    if kept <= best:
        return (
            f"{text}, no more than with the whole past: what memory gains here needs no past of "
            "the sufferer."
        )
    return (
        f"{text}: {100 * (plain - kept) / (plain - best):.0f} % of what memory gains is there "
        "without any past of the sufferer. How much of the rest is the wake's, and how much is "
        "differentiated out of that motion, these lines cannot say."
    )
