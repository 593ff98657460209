"""What study 1 says of made-up results, in both directions: nothing that the numbers deny."""

import numpy as np
import pytest

from wakedeploy.study.claims import claims
from wakedeploy.study.domains import MAIN, MEMORYLESS, SOURCE_ONLY, Line, change, r2_over_seeds
from wakedeploy.study.domains_figure import bars, best_over_kinds, parts
from wakedeploy.study.domains_sentence import sentence
from wakedeploy.study.runs import Wanted

UNITS = 10


def line(
    predictor: str,
    share: float,
    validation: float | None = None,
    *,
    seed: int | None = 0,
    domain: str = "toy",
    hard: np.ndarray | None = None,
    hidden: tuple[str, ...] = (),
    inputs: tuple[str, ...] = (),
) -> Line:
    """A line with this share of the standard deviation as error, `hard` times it in each unit."""
    hard = np.ones(UNITS) if hard is None else hard
    squares = 100.0 * share**2 * hard**2 / np.mean(hard**2)
    by_unit = np.array([np.full(UNITS, 100.0), np.zeros(UNITS), np.full(UNITS, 100.0), squares])
    name = MAIN.get(domain, "force")
    channel = {"channel": name, "unit": "N", "rmse": share, "sd": 1.0, "r2": 1.0 - share**2,
               "r2_low": None, "r2_high": None, "rmse_low": None, "rmse_high": None}  # fmt: skip
    loss = None if seed is None else share if validation is None else validation
    wanted = None if seed is None else Wanted("gru", seed, present_only=hidden)
    return Line(domain, predictor, seed, (channel,), {}, loss, wanted, inputs, by_unit[:, :, None])


@pytest.mark.parametrize("domain", ["toy", "crazyflie", "quadrotor", "ship", "fish"])
@pytest.mark.parametrize(("plain", "memory"), [(0.8, 0.2), (0.5, 0.6)])
def test_the_best_on_validation_is_judged_on_test(domain: str, plain: float, memory: float) -> None:
    told = sentence(domain, [line(MEMORYLESS, plain, 0.9, domain=domain),
                             line("gru", memory, 0.1, domain=domain)])  # fmt: skip
    assert f"On {domain}, gru is the best on validation." in told
    assert f"{int(memory < plain)} of 1 models with memory err less than the one without" in told
    change_per_cent = 100.0 * (memory / plain - 1.0)
    words = "takes 75 % off the error" if memory < plain else "adds 20 % to the error"
    assert f"memory {words} (90 % interval {change_per_cent:+.0f} to" in told.replace("Mem", "mem")
    assert ("On air that was really measured" in told) == (domain == "crazyflie")
    assert "is the best," not in told
    assert "factor" not in told
    if domain == "fish":
        assert f"it has R² {1.0 - memory**2:.3f} [" in told
        assert f"against R² {1.0 - plain**2:.3f} [" in told
        assert "of flag_tip_m without memory" in told
    elif domain in MAIN:
        assert f"an error of {memory:.2f} of force_z_n's standard deviation" in told


@pytest.mark.parametrize("others", [{"gru": 0.5, "tcn": 0.7}, {"gru": 0.15, "tcn": 0.1}])
def test_a_memoryless_best_on_validation_may_be_beaten_on_test(others: dict[str, float]) -> None:
    told = sentence("toy", [line(MEMORYLESS, 0.2, 0.1), *(line(n, v) for n, v in others.items())])
    better = sum(v < 0.2 for v in others.values())
    least = min(others, key=lambda n: others[n])
    assert "agile-mlp is the best on validation. It has no memory" in told
    assert f"{better} of 2 models with memory err less" in told
    assert f"the least, {least}, has an error of {others[least]:.2f}" in told


def test_whether_memory_helps_is_left_open_where_the_episodes_cannot_tell() -> None:
    rng = np.random.default_rng(0)
    mixed = [line(MEMORYLESS, 0.50, 0.9, hard=np.exp(rng.normal(0, 0.5, UNITS))),
             line("gru", 0.48, 0.1, hard=np.exp(rng.normal(0, 0.5, UNITS)))]  # fmt: skip
    assert "these episodes cannot tell whether memory helps" in sentence("toy", mixed)
    hard = np.exp(rng.normal(0, 0.5, UNITS))  # the same for both: their difference is sure
    sure = [line(MEMORYLESS, 0.50, 0.9, hard=hard), line("gru", 0.48, 0.1, hard=hard)]
    assert "cannot tell" not in sentence("toy", sure)
    assert change(sure[1:], sure[:1]) == pytest.approx((-0.04, -0.04))
    low, high = change(mixed[1:], mixed[:1])
    assert low < -0.04 < high


def test_a_model_that_learned_nothing_is_told() -> None:
    told = [line("zero", 1.0, seed=None), line(MEMORYLESS, 3.0)]
    assert "no better than a constant would" in sentence("toy", [*told, line("gru", 1.1, 0.1)])
    assert "constant" not in sentence("toy", [*told, line("gru", 0.9, 0.1)])


@pytest.mark.parametrize(
    ("kept", "said"),
    [
        (0.6, "33 % of what memory gains is there without any past of the sufferer"),
        (0.2, "no more than with the whole past: what memory gains here needs no past"),
        (0.1, "no more than with the whole past: what memory gains here needs no past"),
        (0.9, "no less than without memory: nothing of what memory gains is left"),
    ],
)
def test_the_sources_share_is_never_more_than_all(kept: float, said: str) -> None:
    channels = ("own_a", "source_b", "own_c", "source_d")
    hiding = {"hidden": ("own_a", "own_c"), "inputs": channels}
    lines = [line(MEMORYLESS, 0.8), line("gru", 0.2, 0.1),
             line("gru" + SOURCE_ONLY, kept, 0.2, **hiding),
             line("tcn" + SOURCE_ONLY, 0.05, 0.3, **hiding)]  # fmt: skip
    told = sentence("toy", lines)
    assert f"gru is the best on validation and errs by {kept:.2f}" in told
    assert "they see the past of 2 of 4 channels: source_b, source_d" in told
    assert said in told
    lines[1] = line("gru", 0.9, 0.1)  # memory gains nothing: no share of it
    assert "% of what memory gains" not in sentence("toy", lines)
    assert "what memory gains here" not in sentence("toy", lines)


def made(domain: str, **errors: float) -> list[Line]:
    return [line(name.replace("_", "-"), v, domain=domain) for name, v in errors.items()]


def test_the_papers_quadrotors_agree_or_not_claim_by_claim() -> None:
    papers = {"agile_mlp": 0.6, "history_mlp": 0.5, "gru": 0.45, "esn": 0.7}
    papers |= {"cross_attention": 0.3, "delay_embedding": 0.4}
    alike = claims("quadrotor", made("quadrotor", **papers))
    assert "here 4 of 4 do, which agrees" in alike
    assert "does not beat it there and does not here, which agrees" in alike
    assert "here cross-attention and delay-embedding, which agrees" in alike
    assert "does not agree" not in alike
    others = papers | {"history_mlp": 0.7, "esn": 0.3, "cross_attention": 0.5}
    other = claims("quadrotor", made("quadrotor", **others))
    assert "here 3 of 4 do, which does not agree" in other
    assert "does not beat it there and does here, which does not agree" in other
    assert "here esn and delay-embedding, which does not agree" in other


def test_the_papers_ships_and_fish_agree_or_not() -> None:
    alike = claims("ship", made("ship", agile_mlp=0.9, history_mlp=0.5, gru=0.6))
    assert "here 2 of 2 do, which agrees" in alike
    assert "here history-mlp errs least on test episodes, which agrees" in alike
    other = claims("ship", made("ship", agile_mlp=0.5, history_mlp=0.9, gru=0.6))
    assert "here 0 of 2 do, which does not agree" in other
    assert "here agile-mlp errs least on test episodes, which does not agree" in other
    alike = claims("fish", made("fish", agile_mlp=0.43**0.5, gru=0.04**0.5, tcn=0.3))
    assert "R² 0.57 without memory and 0.570 is found here, which agrees" in alike
    assert "R² 0.96 for its GRU and 0.960 is found here, which agrees" in alike
    assert "here gru and agile-mlp are on the test block, which agrees" in alike
    other = claims("fish", made("fish", agile_mlp=0.3, gru=0.5, tcn=0.2))
    assert other.count("does not agree") == 3
    for domain in ("gantry", "downwash"):
        assert "here 0 of 1 do, which does not" in claims(domain, made(domain, agile_mlp=1, gru=2))
        assert "here 1 of 1 do, which agrees" in claims(domain, made(domain, agile_mlp=2, gru=1))
    assert claims("crazyflie", made("crazyflie", agile_mlp=0.3, gru=0.5)) == ""


def test_an_order_within_the_noise_is_no_verdict() -> None:
    """Two that are hard on different episodes, the claimed one ahead by less than that noise."""
    rng = np.random.default_rng(0)
    hard = [np.exp(rng.normal(0, 0.5, UNITS)) for _ in range(2)]
    own = {"agile-mlp": (0.9, hard[0]), "gru": (0.48, hard[0]), "history-mlp": (0.50, hard[1])}
    for domain, ahead, behind in (("fish", "gru", "history-mlp"), ("ship", "history-mlp", "gru")):
        lines = [line(n, v, domain=domain, hard=h) for n, (v, h) in own.items()]
        assert f", but these episodes cannot tell {ahead} from {behind}" in claims(domain, lines)


def test_the_headline_counts_the_domains_where_memory_helps() -> None:
    told = {
        "toy": [line(MEMORYLESS, 0.8, 0.5), line("gru", 0.4, 0.2), line("tcn", 0.2, 0.3)],
        "other": [line(MEMORYLESS, 0.5, 0.1), line("gru", 0.6, 0.2)],
        "third": [line("gru", 0.6, 0.2)],
    }
    first = parts(told)[0].sentence
    assert first.startswith("In 1 of 2 domains the memory that is best on validation errs less")
    assert "(-50 % on toy, +20 % on other)" in first


def test_figure_and_tables_stand_on_the_channel_that_is_told() -> None:
    told = {"quadrotor": [line("zero", 1.2, seed=None, domain="quadrotor"),
                          line("no-learning observer", 0.6, seed=None, domain="quadrotor"),
                          *made("quadrotor", agile_mlp=0.7, gru=0.5)]}  # fmt: skip
    (axes,) = bars(told).axes
    assert axes.get_title(loc="left") == "quadrotor, force_z_n"
    assert "no-learning observer" in axes.get_legend_handles_labels()[1]
    assert [t.get_text() for t in axes.texts] == ["zero: 1.20 →"]
    assert best_over_kinds(told["quadrotor"][:2]) is None
    first = parts(told)[0]
    assert len(first.columns) == len(first.rows[0])
    both = [line("gru", 0.5), line("gru", 0.7, seed=1)]
    assert r2_over_seeds(both, 0).value == pytest.approx(1.0 - 0.5 * (0.25 + 0.49))
