"""Study of basins: where Delay Embedding's delay ends, by where its training begins.

In: the fish recordings, whose foil beats at nearly one frequency, so that the flag's tip echoes it
after the true delay and, upside down and weaker, about half a beat earlier: an alias. Out: the
delay and R² that each start leads to.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from wakedeploy.core.episodes import EpisodeSet
from wakedeploy.core.errors import UnusableInput
from wakedeploy.study.domains import predicted
from wakedeploy.study.runs import Wanted, obtained_run
from wakedeploy.study.uncertainty import FloatArray, r2_with_interval, units_of

STARTS_S = (0.04, 0.095, 0.15, 0.205, 0.26, 0.315, 0.37, 0.425, 0.48)  # the window is 0.5 s long
QUICK_STARTS_S = (0.04, 0.15, 0.37)
START = "initial_delay_s"
TRUE, ALIAS, UNHARMED, ELSEWHERE = "true delay", "alias", "alias at no clear cost", "elsewhere"
_DRAWS = 20_000  # enough for some in the tail that each run gets
_RISK = 0.05  # of calling any run at all worse that is not


@dataclass(frozen=True, eq=False)
class Echo:
    """How a response follows its drive: correlation (L,) at lags (L,) [s], and two of its extremes.

    `true_s` is where the largest positive peak lies, `alias_s` the deepest negative extremum, both
    between samples, by a parabola.
    """

    lags_s: FloatArray = field(repr=False)
    correlation: FloatArray = field(repr=False)
    true_s: float
    alias_s: float


@dataclass(frozen=True)
class End:
    """One run: its start μ₀, the delay it ended with and that delay's width [s], its test R².

    `delay_s`, `spread_s`: mean and standard deviation of μ over the test samples. `width_s`: mean σ
    of the kernel. `mean_age_s`: the mean age of what the kernel weighs. `r2_low`, `r2_high`: the
    90 % interval over blocks of time, None with too few. `validation`: the least loss on the
    validation block. `behind_low`: by how much R² is at least below that of the run whose
    validation loss is least; 5 % is the risk that this is wrong of any of the runs.
    """

    start_s: float
    seed: int
    delay_s: float
    spread_s: float
    width_s: float
    mean_age_s: float
    r2: float
    r2_low: float | None
    r2_high: float | None
    validation: float
    behind_low: float


def planned(seeds: int, epochs: int | None, *, quick: bool) -> list[Wanted]:
    """The runs of the study, start by start."""
    starts = QUICK_STARTS_S if quick else STARTS_S
    return [
        Wanted("delay-embedding", seed, epochs, hyper={START: start_s})
        for start_s in starts
        for seed in range(seeds)
    ]


def echo_of(data: EpisodeSet) -> Echo:
    """How the first force follows the first observation of the training episodes, in the window."""
    episodes = data.part("train")
    drives = [e.observation[:, 0].astype(float) for e in episodes]
    responses = [e.force[:, 0].astype(float) for e in episodes]
    return echo(drives, responses, data.rate_hz, data.window_s)


def echo(
    drives: Sequence[FloatArray], responses: Sequence[FloatArray], rate_hz: float, longest_s: float
) -> Echo:
    """Correlate responses with drives, episode by episode (T,), at lags of 0 up to `longest_s`.

    Raises UnusableInput where the correlation has no positive peak or no negative one in there.
    """
    lags = np.arange(round(longest_s * rate_hz) + 1)
    correlation = np.array([_correlation(drives, responses, int(lag)) for lag in lags])
    true = _highest(correlation)
    alias = _highest(-correlation)
    if true is None or alias is None:
        raise UnusableInput(
            f"Within {longest_s:g} s the response has no positive and negative correlation peak to "
            "tell a delay from its alias; record a drive that swings."
        )
    return Echo(lags / rate_hz, correlation, true / rate_hz, alias / rate_hz)


def ended(data: EpisodeSet, runs: Sequence[Wanted], folder: Path) -> list[End]:
    """Where each run ended, on the test block; trains what is not trained yet."""
    from trainers.inspection.lookback import kernels
    from trainers.training.tape import lay_tape

    tape = lay_tape(data, "test", 0.0, data.warm_up_steps)
    trained = [obtained_run(data, wanted, folder) for wanted in runs]
    forecasts = [predicted(run.predictor, data) for run in trained]
    truth, episode = forecasts[0][0][:, 0], forecasts[0][2]
    errors = np.array([forces[:, 0] for _, forces, _ in forecasts]) - truth
    block = units_of(data, episode)
    losses = [min(run.metrics.history) for run in trained]
    low = behind(truth, errors, block, int(np.argmin(losses)))
    ends = []
    for i, wanted in enumerate(runs):
        chosen = kernels(trained[i].predictor, tape)
        r2 = r2_with_interval(truth, errors[i], block)
        ends.append(
            End(
                float(wanted.hyper[START]),
                wanted.seed,
                float(chosen.delay_s.mean()),
                float(chosen.delay_s.std()),
                float(chosen.width_s.mean()),
                float(chosen.mean_age_s.mean()),
                *(r2.value, r2.low, r2.high),
                losses[i],
                float(low[i]),
            )
        )
    return ends


def reference(ends: Sequence[End]) -> End:
    """The run that others are compared with: the best one on validation, not on the test block."""
    return min(ends, key=lambda end: end.validation)


def behind(
    truth: FloatArray, errors: FloatArray, block: npt.NDArray[np.int64], reference: int
) -> FloatArray:
    """By how much each run's R² is at least below that of the run `reference`, (R,).

    `truth` (n,), `errors` (R, n), `block` (n,). Whole blocks are drawn, the same for all runs: what
    is hard for one is hard for all, so that their difference is surer than either. In 5 % of the
    draws over the number of comparisons (Bonferroni) it is less: among many equal runs one would
    otherwise look worse by chance.
    """
    _, index = np.unique(block, return_inverse=True)
    count = int(index.max()) + 1
    squares = np.array([np.bincount(index, error**2, count) for error in errors])  # (R, blocks)
    spread = np.bincount(index, (truth - truth.mean()) ** 2, count)
    even = np.full(count, 1.0 / count)
    times = np.random.default_rng(0).multinomial(count, even, _DRAWS)  # each block is drawn
    lost = (squares @ times.T) / (times @ spread)  # (R, draws): 1 − R²
    tail = _RISK / max(1, len(errors) - 1)
    return np.asarray(np.quantile(lost - lost[reference], tail, axis=1))


def where(end: End, echo: Echo) -> str:
    """Whether a run ended at the true delay, at the alias, or elsewhere.

    At either means nearer to it than half of their distance, and that the delay varies by less over
    the samples: a mean between two delays that are both used is not at either. A run at the alias
    whose R² is not clearly below the reference's has a name of its own: the block shows no harm
    from the alias.
    """
    reach_s = 0.5 * abs(echo.true_s - echo.alias_s)
    if end.spread_s >= reach_s:
        return ELSEWHERE
    if abs(end.delay_s - echo.true_s) < reach_s:
        return TRUE
    if abs(end.delay_s - echo.alias_s) < reach_s:
        return ALIAS if end.behind_low > 0.0 else UNHARMED
    return ELSEWHERE


def _correlation(drives: Sequence[FloatArray], responses: Sequence[FloatArray], lag: int) -> float:
    """Pearson's coefficient of drive(t − lag) and response(t), all episodes together."""
    before = np.concatenate([drive[: len(drive) - lag] for drive in drives])
    after = np.concatenate([response[lag:] for response in responses])
    return float(np.corrcoef(before, after)[0, 1])


def _highest(values: FloatArray) -> float | None:
    """Where the highest positive inner peak lies, in samples, by the parabola through its top."""
    inner = np.arange(1, len(values) - 1)
    top = (values[inner] >= values[inner - 1]) & (values[inner] > values[inner + 1])
    peaks = inner[top & (values[inner] > 0.0)]
    if len(peaks) == 0:
        return None
    at = int(peaks[np.argmax(values[peaks])])
    before, centre, after = values[at - 1 : at + 2]
    return at + 0.5 * float((before - after) / (before - 2.0 * centre + after))
