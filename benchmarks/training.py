"""Training beside a plain PyTorch loop: targets a second, the error both end with, where time goes.

Both train the same predictor from the same weights with the same loss, optimiser, schedule and
normalisation, on the same number of targets, in alternating turns of one process and one thread.
The plain loop is what most papers use: every target's window is stored whole, a DataLoader draws
shuffled batches, a recurrent model runs over each window from a zero state for one target, and
attention embeds every snapshot of each. Where torch has a unit of its own, the plain loop uses it.
Two trainings in a process each then say what two cores reach, as a sweep uses them.

    OMP_NUM_THREADS=1 python -m benchmarks.training --json docs/records/training-speed.json
"""

import argparse
import dataclasses
import hashlib
import json
import math
import multiprocessing
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from threading import Barrier
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.functional import scaled_dot_product_attention
from torch.utils.data import DataLoader, TensorDataset

from benchmarks import records
from benchmarks.multiply_adds import MultiplyAdds
from trainers.architectures.cross_attention import CrossAttention
from trainers.architectures.gru import Gru
from trainers.build import ARCHITECTURES
from trainers.memory import Memory
from trainers.model import Predictor, WakeModel, window_indices
from trainers.training.fit import Fit, learning_rate
from trainers.training.loss import WeightedMse
from trainers.training.runs import RunConfig, new_predictor
from trainers.training.tape import Tape
from trainers.training.trainer import configure, new_fit, settings_for, stated_lead_s, tapes
from wakedeploy.core.episodes import EpisodeSet, read_episode_set

DESCENDING = tuple(arch for arch in ARCHITECTURES if arch != "esn")  # the reservoir is solved
REFERENCE = 1024  # rows and columns of the matrix product that says what the core can do
AT_ONCE = 4096  # windows validated together
SIDE_EPOCHS = 3  # of each training beside others
TOGETHER_S = 600.0  # for which one waits for the others
MATRIX = ("addmm", "aten::mm", "bmm", "baddbmm", "convolution", "mkldnn_linear", "thnn_conv")
INDEXING = ("aten::index", "aten::gather", "aten::where", "aten::minimum", "aten::maximum")
RECURRENCE = ("_LinearRecurrence", "_GruSequence")  # but for the matrix products in it
UPDATE = "update"  # the optimiser's own part of one
ERRORS = ("ours", "ours, twice as long", "plain")
SHARES = ("matrix products", "recurrence", "optimiser", "indexing", "other operations", "Python")


def main() -> None:
    """Measure, print, write."""
    options = _options()
    torch.set_num_threads(1)
    data = _data(options)
    archs = DESCENDING if options.arch == "all" else tuple(options.arch.split(","))
    epochs, seeds = (2, 1) if options.quick else (options.epochs, options.seeds)
    result = measured(data, archs, epochs, seeds, report=print, cores=2)
    result |= {"quick": options.quick, "minutes": data.provenance.get("minutes")}
    print("\n" + table(result["rows"]))
    if options.json:
        records.write(options.json, result)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arch", default="all", help="all, or NAME[,NAME…]")
    parser.add_argument("--data", type=Path, help="an episode set; default: simulated gantry")
    parser.add_argument("--minutes", type=float, default=10.0, help="of gantry that are simulated")
    parser.add_argument("--epochs", type=int, default=20, help="as many turns")
    parser.add_argument("--seeds", type=int, default=3, help="trainings of each architecture")
    parser.add_argument("--quick", action="store_true", help="little data, two turns, one seed")
    parser.add_argument("--json", type=Path)
    return parser.parse_args()


def _data(options: argparse.Namespace) -> EpisodeSet:
    if options.data:
        return read_episode_set(options.data)
    from wakedeploy.domains.gantry import make_set

    return make_set(None, minutes=2.0 if options.quick else options.minutes, seed=0)


def measured(
    data: EpisodeSet,
    archs: Sequence[str],
    epochs: int,
    seeds: int,
    report: Callable[[str], None] = lambda text: None,
    cores: int = 1,
) -> dict[str, Any]:
    """Every architecture's row, and what it was measured on; `cores` also at once, if several."""
    rows = []
    for arch in archs:
        settings = dataclasses.replace(settings_for(arch), epochs=epochs, patience=epochs)
        configs = [
            configure(data, arch, seed=seed, lead_s=stated_lead_s(data), settings=settings)
            for seed in range(seeds)
        ]
        rows.append(compared(configs, data))
        if cores > 1:
            rows[-1]["at_once"] = at_once(configs[0], data, cores)
        report(json.dumps(rows[-1]))
    return {
        "domain": data.domain,
        "data_sha256": data.sha256,
        "epochs": epochs,
        "seeds": seeds,
        "window_samples": data.warm_up_steps + 1,
        "equal": "number of targets",
        "threads": torch.get_num_threads(),
        "torch": torch.__version__,
        "rows": rows,
    }


class CountedLoss:
    """A loss that counts the targets that a gradient was taken of."""

    def __init__(self, loss: WeightedMse) -> None:
        self.loss, self.targets, self.updates = loss, 0, 0

    def __call__(self, predicted: Tensor, target: Tensor, scored: Tensor | None = None) -> Tensor:
        """As the loss's own."""
        if predicted.requires_grad:
            self.updates += 1
            self.targets += target.shape[:-1].numel() if scored is None else int(scored.sum())
        return self.loss(predicted, target, scored)


class PlainLoop:
    """Windows stored whole, a DataLoader that shuffles them, one target each.

    An update has as many targets as one of ours, which is kind to it: small batches cost more.
    """

    def __init__(self, config: RunConfig, learned: Tape, held_out: Tape, total: int) -> None:
        self.config, self.total = config, total
        self.predictor = predictor = new_predictor(config)
        predictor.set_normalisation(learned.observation, learned.force)
        self.loss = CountedLoss(WeightedMse(config.loss_weights, predictor.force_sd))
        self.learned, self.held_out = (self._samples(tape) for tape in (learned, held_out))
        s = self.settings = settings_for(config.arch, others=dict(config.settings))
        batch = s.lanes * s.chunk_steps if predictor.memory.kind == "state" else s.batch
        torch.manual_seed(config.seed)
        self.loader = DataLoader(self.learned, batch_size=batch, shuffle=True)
        decays = [p for p in predictor.parameters() if p.dim() > 1]
        others = [p for p in predictor.parameters() if p.dim() <= 1]
        groups = [
            {"params": decays, "weight_decay": s.weight_decay},
            {"params": others, "weight_decay": 0.0},
        ]
        self.optimiser = torch.optim.AdamW(groups, lr=s.learning_rate)
        self.batches = self._shuffled_for_ever()

    def play(self, targets: int) -> None:
        """Learn from `targets` more targets; what is left of the last batch is not used."""
        self.predictor.train()
        remaining = targets
        while remaining > 0:
            windows, wanted = next(self.batches)
            windows, wanted = windows[:remaining], wanted[:remaining]
            remaining -= len(windows)
            rate = learning_rate(self.settings, self.settings.epochs * self.progress)
            for group in self.optimiser.param_groups:
                group["lr"] = rate
            self.optimiser.zero_grad()
            self.loss(newest_force(self.predictor.core, windows), wanted).backward()
            nn.utils.clip_grad_norm_(self.predictor.parameters(), self.settings.gradient_clip)
            self.optimiser.step()

    @property
    def progress(self) -> float:
        """How far through the training, 0 to 1."""
        return self.loss.targets / self.total

    @torch.no_grad()
    def validate(self) -> float:
        """The loss over the scored validation samples, each from its window."""
        self.predictor.eval()
        windows, wanted = self.held_out.tensors
        forces = [newest_force(self.predictor.core, some) for some in windows.split(AT_ONCE)]
        return self.loss(torch.cat(forces), wanted).item()

    def _shuffled_for_ever(self) -> Iterator[list[Tensor]]:
        while True:
            yield from self.loader

    def _samples(self, tape: Tape) -> TensorDataset:
        """Normalised windows (M, K, d) and targets (M, o) of the scored samples."""
        p = self.predictor
        newest = torch.nonzero(tape.scored).squeeze(1)
        memory = p.memory
        if memory.kind == "state":
            memory = Memory("window", k=self.config.warm_up_steps + 1)
        windows = p.normalise(tape.observation)[window_indices(newest, memory)]  # (M, K, d)
        windows = windows[:, -1] if memory.kind == "none" else windows
        return TensorDataset(windows, ((tape.force - p.force_mean) / p.force_sd)[newest])


def newest_force(core: WakeModel, windows: Tensor) -> Tensor:
    """The force at each window's end, (B, K, d) -> (B, o); a recurrent core starts at zero."""
    if isinstance(core, CrossAttention):
        return attended_plainly(core, windows)
    if core.memory.kind != "state":
        return core(windows)
    if isinstance(core, Gru):  # torch's own unit; its head is spared where it is not asked
        return core.head(core.gru(core.projection(windows))[0][:, -1])
    return core(windows)[0][:, -1]


def attended_plainly(core: CrossAttention, windows: Tensor) -> Tensor:
    """Cross-Attention as it is written down, a key and a value for every snapshot of each window.

    Shapes: (B, K, d) -> (B, o).
    """
    asking = core.embed_query(windows[:, -1:]) + core.positions[-1]  # (B, 1, E)
    past = core.embed_past(windows) + core.positions  # (B, K, E)
    given = (core.query(asking), core.key(past), core.value(past))
    by_head = (x.unflatten(2, (core.heads, core.width)).transpose(1, 2) for x in given)
    seen = scaled_dot_product_attention(*by_head).transpose(1, 2).flatten(2)  # (B, 1, E)
    x = core.norm_attended(asking + core.mix(seen)).squeeze(1)  # (B, E)
    return core.head(core.norm_fed(x + core.feed_forward(x)))


def compared(configs: Sequence[RunConfig], data: EpisodeSet) -> dict[str, Any]:
    """One architecture's row: all seeds' turns, their errors, and where our time goes."""
    runs = [turns_of(config, data) for config in configs]
    rates = {name: np.array([r for run in runs for r in run[name]]) for name in ("ours", "plain")}
    core_gflops = float(np.median([rate for run in runs for rate in run["core_gflops"]]))
    row: dict[str, Any] = {"arch": configs[0].arch}
    row |= {"trainable": new_predictor(configs[0]).trainable}
    row |= {f"{name}_per_s": _spread(loop_rates) for name, loop_rates in rates.items()}
    row["ratio"] = _spread(rates["ours"] / rates["plain"])
    for name in ("targets", "updates", "errors", "initial_sha256"):
        row[name] = {who: [run[name][who] for run in runs] for who in ("ours", "plain")}
    row["plain_error_carried"] = [run["plain_error_carried"] for run in runs]
    if new_predictor(configs[0]).memory.kind == "state":
        row["errors"]["ours, twice as long"] = [twice_as_long(config, data) for config in configs]
    row["core_gflops"] = core_gflops
    for name, flops in flops_per_target(configs[0], data).items():
        gflops = 1e-9 * flops * row[f"{name}_per_s"]["median"]
        row[f"{name}_flops_per_target"] = flops
        row[f"{name}_share_of_core"] = gflops / core_gflops
    row["shares"] = shares(configs[0], data)
    return row


def _spread(values: np.ndarray) -> dict[str, float]:
    low, median, high = np.quantile(values, [0.1, 0.5, 0.9])
    return {"median": float(median), "low": float(low), "high": float(high)}


def turns_of(config: RunConfig, data: EpisodeSet) -> dict[str, Any]:
    """One training each, in turns of an epoch of ours, and as many targets of the plain loop's."""
    learned, held_out = tapes(data, config.lead_s)
    ours = counted_fit(config, data)
    plain = PlainLoop(config, learned, held_out, total=_targets(config, data))
    both = {"ours": ours.predictor, "plain": plain.predictor}
    turns: dict[str, Any] = {"ours": [], "plain": [], "core_gflops": []}
    turns["initial_sha256"] = {name: _sha256(predictor) for name, predictor in both.items()}
    for _ in range(ours.settings.epochs):
        before = ours.loss.targets
        took_s = _seconds(ours.train_epoch)
        targets = ours.loss.targets - before
        turns["ours"].append(targets / took_s)
        ours.end_epoch()
        turns["plain"].append(targets / _seconds(lambda n=targets: plain.play(n)))
        turns["core_gflops"].append(core_gflops())
    for name in ("targets", "updates"):
        turns[name] = {"ours": getattr(ours.loss, name), "plain": getattr(plain.loss, name)}
    losses = {"ours": ours.standing.history[-1], "plain": plain.validate()}
    turns["errors"] = {name: math.sqrt(loss) for name, loss in losses.items()}
    ours.predictor.load_state_dict(plain.predictor.state_dict())
    return turns | {"plain_error_carried": math.sqrt(ours.validate())}  # as it would be flown


def twice_as_long(config: RunConfig, data: EpisodeSet) -> float:
    """The error of our training alone with twice the epochs.

    As many targets teach less in sequences than drawn at random as windows, and ours has time for
    more.
    """
    epochs = 2 * int(config.settings["epochs"])
    longer = config.model_copy(update={"settings": {**config.settings, "epochs": epochs}})
    fit = counted_fit(longer, data)
    for _ in range(epochs):
        fit.train_epoch()
        fit.end_epoch()
    return math.sqrt(fit.standing.history[-1])


def at_once(config: RunConfig, data: EpisodeSet, cores: int) -> dict[str, float]:
    """As many trainings as cores, a process and a thread each: together, and beside their limit."""
    context = multiprocessing.get_context("spawn")  # torch does not survive a fork
    with context.Manager() as manager, context.Pool(cores) as pool:
        given = [(config, data, manager.Barrier(cores, timeout=TOGETHER_S))] * cores
        rates = pool.starmap(_one_of_several, given)
    per_s, gflops = (sum(kind) for kind in zip(*rates, strict=True))
    share = 1e-9 * flops_per_target(config, data)["ours"] * per_s / gflops
    return {"cores": cores, "per_s": per_s, "core_gflops": gflops, "share_of_cores": share}


def _one_of_several(config: RunConfig, data: EpisodeSet, together: Barrier) -> tuple[float, float]:
    """Targets a second, and 10⁹ operations a second in matrix products, beside the others."""
    torch.set_num_threads(1)
    fit = counted_fit(config, data)
    fit.train_epoch()
    before = fit.loss.targets
    together.wait()
    took_s = _seconds(lambda: [fit.train_epoch() for _ in range(SIDE_EPOCHS)])
    together.wait()
    limit = max(core_gflops() for _ in range(3))  # what disturbs one is no limit
    return (fit.loss.targets - before) / took_s, limit


def counted_fit(config: RunConfig, data: EpisodeSet) -> Fit:
    """Our training before its first epoch, its targets counted."""
    fit = new_fit(config, new_predictor(config), *tapes(data, config.lead_s))
    fit.loss = CountedLoss(fit.loss)
    return fit


def _targets(config: RunConfig, data: EpisodeSet) -> int:
    """About how many targets the whole training has; sequences lose a few to their first cut."""
    learned, _ = tapes(data, config.lead_s)
    return int(learned.scored.sum()) * int(config.settings["epochs"])


def _sha256(predictor: Predictor) -> str:
    digest = hashlib.sha256()
    for value in predictor.state_dict().values():
        digest.update(value.numpy().tobytes())
    return digest.hexdigest()


def _seconds(work: Callable[[], object]) -> float:
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def core_gflops() -> float:
    """What one thread reaches in a large float32 matrix product, in 10⁹ operations a second."""
    square = torch.ones(REFERENCE, REFERENCE)
    return 2e-9 * REFERENCE**3 / min(_seconds(lambda: square @ square) for _ in range(3))


def flops_per_target(config: RunConfig, data: EpisodeSet) -> dict[str, float]:
    """Floating-point operations, forward and backward, that each way spends on one target.

    Samples that only warm a state up, or fill a lane, count as spent.
    """
    learned, held_out = tapes(data, config.lead_s)
    ours = counted_fit(config, data)
    plain = PlainLoop(config, learned, held_out, total=_targets(config, data))
    played = {"ours": ours.train_epoch, "plain": lambda: plain.play(256)}
    flops = {}
    for name, loop in (("ours", ours), ("plain", plain)):
        with MultiplyAdds(loop.predictor.core) as counted:
            played[name]()
        flops[name] = 2.0 * counted.count / loop.loss.targets
    return flops


def shares(config: RunConfig, data: EpisodeSet) -> dict[str, float]:
    """Where an epoch of ours spends its time, by torch's profiler; they sum to 1.

    The profiler itself costs time, most where operations are small: read them as proportions.
    """
    fit = counted_fit(config, data)
    fit.train_epoch()
    update = torch.profiler.record_function(UPDATE)(fit.optimiser.update)
    fit.optimiser.update = update  # type: ignore[method-assign]
    with torch.profiler.profile(activities=[torch.profiler.ProfilerActivity.CPU]) as seen:
        took_us = 1e6 * _seconds(fit.train_epoch)
    spent = dict.fromkeys(SHARES, 0.0)
    for event in seen.events():
        spent[_kind(event)] += event.self_cpu_time_total
    spent["Python"] += max(0.0, took_us - sum(spent.values()))
    total = sum(spent.values())
    return {name: value / total for name, value in spent.items()}


def _kind(event: Any) -> str:
    """The share that an operation of the profiler's belongs to, by its name and its callers'."""
    names = []
    while event is not None:
        names.append(event.name)
        event = event.cpu_parent
    if UPDATE in names:
        return "Python" if names[0] == UPDATE else "optimiser"
    if any(part in names[0] for part in MATRIX):
        return "matrix products"
    if any(part in name for name in names for part in RECURRENCE):
        return "recurrence"
    if any(part in names[0] for part in INDEXING):
        return "indexing"
    return "other operations"


def table(rows: Sequence[dict[str, Any]]) -> str:
    """A Markdown table: median over turns, 10th to 90th percentile, errors of each seed's mean."""
    head = ["", "targets/s", "plain loop", "ratio", "error", "twice as long", "plain"]
    head += ["of the core", "two cores", "of them", *SHARES]
    lines = ["| " + " | ".join(head) + " |", "|---|" + "---:|" * (len(head) - 1)]
    for row in rows:
        cells = [row["arch"]]
        cells += [f"{row[f'{name}_per_s']['median']:,.0f}" for name in ("ours", "plain")]
        ratio = row["ratio"]
        cells += [f"{ratio['median']:.1f} ({ratio['low']:.1f} to {ratio['high']:.1f})"]
        cells += [_mean(row["errors"].get(name, [])) for name in ERRORS]
        cells += [f"{100 * row['ours_share_of_core']:.0f} %"]
        if beside := row.get("at_once"):
            cells += [f"{beside['per_s']:,.0f}", f"{100 * beside['share_of_cores']:.0f} %"]
        cells += ["–"] * (10 - len(cells))
        cells += [f"{100 * row['shares'][name]:.0f} %" for name in SHARES]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _mean(values: Sequence[float]) -> str:
    if not values:
        return "–"
    mean = f"{np.mean(values):.4f}"
    return mean if len(values) < 2 else f"{mean} ± {np.std(values, ddof=1):.4f}"


if __name__ == "__main__":
    main()
