"""The page that lies beside the C: what it is, how to call it, what was proved, what it takes."""

from export.c.source import Model
from runtime.compiled.folder import Document, Rounding


def page(model: Model, document: Document) -> str:
    """README.md of a folder."""
    manifest, name = model.manifest, model.name
    proofs = "\n".join(
        f"| {proof.compiler} | `{proof.flags}` | {proof.max_rel:.1e} |" for proof in document.proofs
    )
    return f"""\
# {name}: {manifest.arch} in C

Predicts the force of a wake on a robot from {len(manifest.observation)} numbers,
{manifest.rate_hz:g} times a second. C99, one source file, no heap, nothing but `<math.h>`. Made by
wakedeploy from the package with the SHA-256 `{model.package_sha256}`.

```c
#include "{name}.h"

static {name}_state state;
float observation[{len(manifest.observation)}], force[{len(manifest.force)}];

{name}_reset(&state);                     /* once */
{name}_step(&state, observation, force);  /* every {1000.0 / manifest.rate_hz:g} ms */
```

Units and ranges of every channel are in `{name}.h`. The force is that of a moment
{manifest.lead_s:g} s after the newest observation. The first that counts is that of step
{manifest.warm_up_steps}.
{_filters(model)}
## What it takes

| | bytes |
|---|---:|
| weights ({document.weights}) in flash | {document.weight_bytes:,} |
| state (`{name}_state`) in RAM | {document.state_bytes:,} |
| arrays of a step on the stack | {document.stack_bytes:,} |

{_exact(model)}Code adds some kilobytes: `arm-none-eabi-size` says how many for your flags. Compile
with `-O2`.

## What was proved

Every build was stepped beside {document.reference.rstrip(",")}, over {document.steps:,} samples or
more. The measure is the worst difference as a share of the force's range, which counts as no less
than a twentieth of the largest force, of the worst channel; the limit is {document.limit:.1e}.

| compiler | flags | difference |
|---|---|---:|
{proofs}
{_rounding(document.rounding, document.weights)}
To repeat it on any machine: `cc -O2 {name}.c {name}_test.c -lm && ./a.out`, or `wakedeploy
check` on this folder. `-ffast-math` was not proved unless the table says so; with it, NaN in is no
longer NaN out.
"""


def _filters(model: Model) -> str:
    """That inputs have to be filtered, where they were in training."""
    filtered = [channel.name for channel in model.manifest.observation if channel.filtered]
    if not filtered:
        return ""
    names = ", ".join(f"`{name}`" for name in filtered)
    return f"""
In training these inputs were filtered: {names}.
Filter them likewise before each step; `{model.name}.h` says how.
"""


def _exact(model: Model) -> str:
    """What stays float32 beside rounded weights, and why."""
    if model.kind == "float32":
        return ""
    exact = [m for m in model.program.matrices if m.kept(model.kind) == "float32"]
    beside = "".join(f", `{m.name}`" for m in exact)
    why = ""
    if model.kind == "int8" and any(m.drives for m in exact):
        why = (
            "\nThe readout of a reservoir was solved for exactly its echoes, so that what leads in"
            " and out is not\nrounded."
        )
    return f"These stay float32: biases, small tables{beside}.{why}\n\n"


def _rounding(rounding: Rounding | None, weights: str) -> str:
    if rounding is None:
        return ""
    if rounding.rmse is None or rounding.float_rmse is None:
        return (
            f"\n{weights} weights change the force by {rounding.rel_rms:.2%} of its own deviation"
            f" (root mean square), on {rounding.on}.\n"
        )
    rows = "\n".join(
        f"| {name} | {rounding.float_rmse[name]:.4g} | {rounding.rmse[name]:.4g} |"
        for name in rounding.rmse
    )
    return f"""
What {weights} weights change on {rounding.on}:

| force | error as trained (RMSE) | with {weights} weights |
|---|---:|---:|
{rows}
"""
