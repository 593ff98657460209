"""The few C functions that steps call; a source holds those that its step needs."""

from export.c.weights import BLOCK, Kind

# Left to itself, gcc 12 makes copies for single sizes, or vectors along a row whose sums it then
# has to take apart: 21 microseconds a step of the GRU, where 9 do with the eight sums in vectors.
_AS_WRITTEN = """\
/* One copy for all sizes; the eight sums side by side in vector registers, where there are any. */
#if defined(__GNUC__) && __GNUC__ >= 8 && !defined(__clang__)
#define AS_WRITTEN \\
    __attribute__((noipa, optimize("no-tree-loop-vectorize", "tree-slp-vectorize", "unroll-loops")))
#else
#define AS_WRITTEN
#endif
"""

_DENSE = """\
/* y = {scaled}matrix * x + bias. Of the matrix eight rows lie together, column by column: each
   input is read once for eight sums, which stay in registers. The rows left over follow. */
static AS_WRITTEN void dense(const FLASH {type} *restrict matrix,{scale}
                             const FLASH float *restrict bias, const float *restrict x,
                             float *restrict y, int inputs, int outputs)
{{
    int row = 0;
    for (int i = 0; i < outputs; ++i) {{
        y[i] = {start};
    }}
    for (; row + 8 <= outputs; row += 8) {{
        float sum_0 = y[row], sum_1 = y[row + 1], sum_2 = y[row + 2], sum_3 = y[row + 3];
        float sum_4 = y[row + 4], sum_5 = y[row + 5], sum_6 = y[row + 6], sum_7 = y[row + 7];
        for (int i = 0; i < inputs; ++i) {{
            const float input = x[i];
            sum_0 += {w0} * input;
            sum_1 += {w1} * input;
            sum_2 += {w2} * input;
            sum_3 += {w3} * input;
            sum_4 += {w4} * input;
            sum_5 += {w5} * input;
            sum_6 += {w6} * input;
            sum_7 += {w7} * input;
            matrix += 8;
        }}
        y[row] = sum_0;
        y[row + 1] = sum_1;
        y[row + 2] = sum_2;
        y[row + 3] = sum_3;
        y[row + 4] = sum_4;
        y[row + 5] = sum_5;
        y[row + 6] = sum_6;
        y[row + 7] = sum_7;
    }}
    for (; row < outputs; ++row) {{
        float sum_0 = 0.0f, sum_1 = 0.0f, sum_2 = 0.0f, sum_3 = 0.0f;
        int i = 0;
        for (; i + 4 <= inputs; i += 4) {{
            sum_0 += {m0} * x[i];
            sum_1 += {m1} * x[i + 1];
            sum_2 += {m2} * x[i + 2];
            sum_3 += {m3} * x[i + 3];
        }}
        for (; i < inputs; ++i) {{
            sum_0 += {m0} * x[i];
        }}
        y[row] += (sum_0 + sum_1) + (sum_2 + sum_3);
        matrix += inputs;
    }}
{finish}}}
"""

_SPARSE = """\
/* y = {scaled}matrix * x + bias, of a matrix that is given by its entries: their columns row by
   row, and how many each row has. */
static AS_WRITTEN void sparse(const FLASH {type} *restrict matrix,{scale}
                              const FLASH uint16_t *restrict columns,
                              const FLASH uint16_t *restrict counts,
                              const FLASH float *restrict bias, const float *restrict x,
                              float *restrict y, int outputs)
{{
    for (int row = 0; row < outputs; ++row) {{
        const int count = counts[row];
        float sum_0 = 0.0f, sum_1 = 0.0f, sum_2 = 0.0f, sum_3 = 0.0f;
        int i = 0;
        for (; i + 4 <= count; i += 4) {{
            sum_0 += {m0} * x[columns[i]];
            sum_1 += {m1} * x[columns[i + 1]];
            sum_2 += {m2} * x[columns[i + 2]];
            sum_3 += {m3} * x[columns[i + 3]];
        }}
        for (; i < count; ++i) {{
            sum_0 += {m0} * x[columns[i]];
        }}
        y[row] = {factor}((sum_0 + sum_1) + (sum_2 + sum_3)) + (bias != 0 ? bias[row] : 0.0f);
        matrix += count;
        columns += count;
    }}
}}
"""

_FEW = """\
/* y = matrix * x + bias, row by row, of a matrix that stays float32 beside rounded ones. */
static AS_WRITTEN void few(const FLASH float *restrict matrix, const FLASH float *restrict bias,
                           const float *restrict x, float *restrict y, int inputs, int outputs)
{
    for (int row = 0; row < outputs; ++row) {
        float sum_0 = 0.0f, sum_1 = 0.0f;
        int i = 0;
        for (; i + 2 <= inputs; i += 2) {
            sum_0 += matrix[i] * x[i];
            sum_1 += matrix[i + 1] * x[i + 1];
        }
        for (; i < inputs; ++i) {
            sum_0 += matrix[i] * x[i];
        }
        y[row] = (sum_0 + sum_1) + (bias != 0 ? bias[row] : 0.0f);
        matrix += inputs;
    }
}
"""

_WIDENED = """\
/* The float32 of an IEEE float16, exactly: exponent and fraction in place, then 112 added to the
   exponent by a product, which subnormal numbers survive. */
static float widened(uint16_t half)
{
    union { uint32_t bits; float value; } wide;
    wide.bits = (uint32_t)(half & 0x7fffu) << 13;
    wide.value *= 5.192296858534828e+33f;
    wide.bits |= (uint32_t)(half & 0x8000u) << 16;
    return wide.value;
}
"""

_SIGMOID = """\
static float sigmoid(float x)
{
    return 1.0f / (1.0f + expf(-x));
}
"""

_SOFTPLUS = """\
#if defined(__AVR__)
/* Its <math.h> has none; the quotient takes the rounding of 1 + x out again (Kahan). */
static float log1pf(float x)
{
    const float above = 1.0f + x;
    return above > 1.0f ? logf(above) * (x / (above - 1.0f)) : x;
}
#endif

/* log(1 + e^x), without an overflow. */
static float softplus(float x)
{
    return x > 0.0f ? x + log1pf(expf(-x)) : log1pf(expf(x));
}
"""

_SOFTMAX = """\
/* y may be x. */
static void softmax(const float *x, float *y, int n)
{
    float largest = x[0], sum = 0.0f;
    for (int i = 1; i < n; ++i) {
        largest = x[i] > largest ? x[i] : largest;
    }
    for (int i = 0; i < n; ++i) {
        y[i] = expf(x[i] - largest);
        sum += y[i];
    }
    for (int i = 0; i < n; ++i) {
        y[i] = y[i] / sum;
    }
}
"""

_LAYER_NORM = """\
static void layer_norm(const float *x, const FLASH float *gain, const FLASH float *bias,
                       float epsilon, float *y, int n)
{
    float mean = 0.0f, variance = 0.0f;
    for (int i = 0; i < n; ++i) {
        mean += x[i];
    }
    mean /= (float)n;
    for (int i = 0; i < n; ++i) {
        variance += (x[i] - mean) * (x[i] - mean);
    }
    const float factor = 1.0f / sqrtf(variance / (float)n + epsilon);
    for (int i = 0; i < n; ++i) {
        y[i] = (x[i] - mean) * factor * gain[i] + bias[i];
    }
}
"""

_BIAS = "bias != 0 ? bias[i] : 0.0f"
_SCALE = """\
    for (int i = 0; i < outputs; ++i) {
        y[i] = scale[i] * y[i] + (bias != 0 ? bias[i] : 0.0f);
    }
"""

_PLAIN = {
    "sigmoid": _SIGMOID,
    "softplus": _SOFTPLUS,
    "softmax": _SOFTMAX,
    "layer_norm": _LAYER_NORM,
}
_TYPES: dict[Kind, str] = {"float32": "float", "float16": "uint16_t", "int8": "int8_t"}


def needed(body: str, kind: Kind) -> list[str]:
    """The functions that a step's text calls, in an order in which C takes them."""
    multiplies = {name: text for name, text in _products(kind).items() if f"{name}(" in body}
    as_written = [_AS_WRITTEN] if multiplies else []
    widened = [_WIDENED] if multiplies and kind == "float16" else []
    plain = [text for name, text in _PLAIN.items() if f"{name}(" in body]
    return [*as_written, *widened, *multiplies.values(), *plain]


def _products(kind: Kind) -> dict[str, str]:
    weights = {f"w{k}": _weight(kind, str(k)) for k in range(BLOCK)}
    weights |= {f"m{k}": _weight(kind, f"i + {k}" if k else "i") for k in range(4)}
    is_scaled = kind == "int8"
    words = {
        "type": _TYPES[kind],
        "scale": " const FLASH float *restrict scale," if is_scaled else "",
        "scaled": "scale * " if is_scaled else "",
        "factor": "scale[row] * " if is_scaled else "",
        "start": "0.0f" if is_scaled else _BIAS,
        "finish": _SCALE if is_scaled else "",
    }
    return {
        "dense": _DENSE.format(**weights, **words),
        "sparse": _SPARSE.format(**weights, **words),
        "few": _FEW,
    }


def _weight(kind: Kind, place: str) -> str:
    """A weight as a float."""
    text = f"matrix[{place}]"
    return {"float32": text, "float16": f"widened({text})", "int8": f"(float){text}"}[kind]
