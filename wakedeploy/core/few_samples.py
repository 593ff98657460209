"""Whether a score rests on enough samples to be believed.

In: how many samples of each split are scored. Out: a sentence where they are too few.
"""

from collections.abc import Mapping

# The root mean square of n independent normal errors has a relative standard deviation of about
# 1 / √(2 n): 7 % for 100, so that 95 % of such scores lie within 14 % of the truth. Samples of a
# recording resemble those before them, which makes it worse. Below, predictors that differ by a
# tenth cannot be told apart.
FEW = 100


def few_samples(counts: Mapping[str, int]) -> str | None:
    """A warning for splits with fewer than `FEW` scored samples, by the name of each; else None.

    A split without any is left out: what is to be scored refuses it.
    """
    few = [f"{count} {split}" for split, count in counts.items() if 0 < count < FEW]
    if not few:
        return None
    samples = "sample is" if few[0].startswith("1 ") and len(few) == 1 else "samples are"
    return (
        f"Only {' and '.join(few)} {samples} scored: an error over fewer than {FEW} is uncertain by"
        " ±14 % at the least. More or longer episodes there help, or a shorter window_s."
    )
