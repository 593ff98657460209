"""The self-test that travels with the C: made inputs, and what the reference gave for them."""

from export.c.source import Model
from export.c.values import literal
from export.c.weights import constants
from runtime.compiled.driven import FACTOR, HELD, INCREMENT, LEVELS
from runtime.replay import size_of
from wakedeploy.core.manifest import FloatArray

_TEMPLATE = """\
/* Made by wakedeploy; do not edit. A program that steps {name}.c beside what {reference} gave for
   the same inputs, and checks that a reset forgets and that two states keep apart.
   It prints the worst difference over the force's range, and ends with 0 where that is within
   the limit. To be compiled with {name}.c; needs <stdio.h> and nothing else. */
#include "{name}.h"

#include <stdio.h>

/* As in {name}.c. */
#if defined(__FLASH)
#define FLASH __flash
#else
#define FLASH
#endif

#define STEPS {steps}
#define HELD {held} /* steps from one level of an input to the next */
#define LIMIT {limit}

{low}
{high}
{sizes}
{expected}

static uint32_t drawn = 1;

/* Levels of all inputs at the next knot (Knuth's linear congruential generator). */
static void draw(int32_t level[{d}])
{{
    for (int i = 0; i < {d}; ++i) {{
        drawn = drawn * {factor}u + {increment}u;
        level[i] = (int32_t)(drawn >> 16);
    }}
}}

/* The inputs of a step: straight lines from knot to knot, over the range seen in training. */
static void observe(int step, float observation[{d}])
{{
    static int32_t last[{d}], next[{d}];
    const int place = step % HELD;
    if (step == 0) {{
        drawn = 1;
        draw(next);
    }}
    if (place == 0) {{
        for (int i = 0; i < {d}; ++i) {{
            last[i] = next[i];
        }}
        draw(next);
    }}
    for (int i = 0; i < {d}; ++i) {{
        const int32_t between = last[i] * (HELD - place) + next[i] * place;
        const float share = (float)between / {most};
        const float above = (high[i] - low[i]) * share;
        observation[i] = low[i] + above;
    }}
}}

static float without_sign(float value)
{{
    return value < 0.0f ? -value : value;
}}

int main(void)
{{
    static {name}_state state, other;
    float observation[{d}], force[{o}], unlike[{o}], worst[{o}] = {{0.0f}};
    float max_rel = 0.0f;
    int is_sound = 1;
    {name}_reset(&state);
    for (int i = 0; i < HELD; ++i) {{
        observe(i, observation);
        {name}_step(&state, observation, force);
    }}
    {name}_reset(&state);
    {name}_reset(&other);
    for (int i = 0; i < STEPS; ++i) {{
        observe(i, observation);
        {name}_step(&state, observation, force);
        for (int j = 0; j < {o}; ++j) {{
            const float apart = without_sign(force[j] - expected[i * {o} + j]);
            is_sound = is_sound && apart <= 3.0e38f; /* false for NaN */
            worst[j] = apart > worst[j] ? apart : worst[j];
        }}
        for (int j = 0; j < {d}; ++j) {{
            observation[j] = high[j] + low[j] - observation[j];
        }}
        if (i < 4 * HELD) {{
            {name}_step(&other, observation, unlike);
        }}
    }}
    for (int j = 0; j < {o}; ++j) {{
        const float relative = worst[j] / range[j];
        max_rel = relative > max_rel ? relative : max_rel;
    }}
    is_sound = is_sound && max_rel <= LIMIT;
    printf("{name}: %s, max_rel %.3e over %d steps, limit %.1e\\n", is_sound ? "passed" : "FAILED",
           (double)max_rel, STEPS, (double)LIMIT);
    return is_sound ? 0 : 1;
}}
"""


def self_test(model: Model, expected: FloatArray, limit: float, reference: str) -> str:
    """The program's text; `expected` (T, o) are the forces for the made inputs."""
    channels = model.manifest.observation
    return _TEMPLATE.format(
        name=model.name,
        reference=reference,
        steps=len(expected),
        held=HELD,
        limit=literal(limit),
        low=_floats("low", [c.min for c in channels]),
        high=_floats("high", [c.max for c in channels]),
        sizes=_floats("range", size_of(expected).tolist()),
        expected=constants(f"expected[STEPS * {expected.shape[1]}]", expected),
        d=len(channels),
        o=expected.shape[1],
        factor=FACTOR,
        increment=INCREMENT,
        most=literal(float(HELD * LEVELS)),
    )


def _floats(name: str, values: list[float]) -> str:
    numbers = ", ".join(map(literal, values))
    return f"static const FLASH float {name}[{len(values)}] = {{{numbers}}};"
