"""What C takes on a microcontroller, computed from the program before anything is compiled.

Bytes are counted. Instructions are an estimate for a Cortex-M4F at gcc -O2: what a step does, by
kind, times what each kind took in the simulator (`docs/records/compiled.json`, the eight reference
shapes).
"""

import re
from collections import Counter
from dataclasses import dataclass

from export.c.lowering import lowered
from export.c.program import Program
from export.c.source import step_body
from export.c.weights import Kind
from wakedeploy.core.onnx_graph import read_graph
from wakedeploy.core.package import Package

# Instructions per piece of work, fitted to the record; tests/export/test_c_cost.py compares them.
INSTRUCTIONS: dict[Kind, dict[str, float]] = {
    "float32": {"product": 3.43, "entry": 7.2, "row": 9.2, "operation": 1.04, "function": 61.0},
}
_LOOP = re.compile(r"for \(int \w+ = 0; \w+ < (.+?); \+\+\w+\) \{")
_OPERATION = re.compile(r"(?<=[\w)\]]) [-+*/%<>?] (?=[\w(-])|=")
_FUNCTIONS = ("expf", "tanhf", "sigmoid", "softplus", "sqrtf")


@dataclass(frozen=True)
class CCost:
    """Bytes of flash for weights and of RAM for state and a step's arrays; instructions a step."""

    flash_bytes: int
    ram_bytes: int
    instructions: int


def c_cost(package: Package) -> CCost:
    """What a package would take as C with float32 weights.

    Code adds some kilobytes of flash, the deepest call a hundred bytes of RAM.
    """
    program = lowered(read_graph(package.model_bytes), package.manifest, "float32")
    work = work_of(program)
    each = INSTRUCTIONS["float32"]
    return CCost(
        flash_bytes=program.weight_bytes("float32"),
        ram_bytes=program.state_bytes + program.room_bytes,
        instructions=round(sum(each[kind] * count for kind, count in work.items())),
    )


def work_of(program: Program) -> Counter[str]:
    """How often a step does what: products of dense matrices, entries of sparse ones, and so on."""
    work: Counter[str] = Counter()
    for matrix in program.matrices:
        outputs, inputs = map(int, matrix.weights.shape)
        if matrix.is_sparse:
            work["entry"] += int((matrix.weights != 0.0).sum())
        else:
            work["product"] += outputs * inputs
        work["row"] += outputs
    times = [1]
    for line in step_body(program).splitlines():
        text = line.strip()
        if text == "}":
            times.pop()
            continue
        count = times[-1]
        work["operation"] += count * len(_OPERATION.findall(text))
        work["function"] += count * sum(text.count(f"{name}(") for name in _FUNCTIONS)
        work["function"] += count * _along_a_row(text)
        if text.endswith("{"):
            times.append(count * _trips(text))
    return work


def _trips(head: str) -> int:
    """How often a loop goes round; one that depends on the state, once."""
    found = _LOOP.match(head)
    return int(found[1]) if found and found[1].isdigit() else 1


def _along_a_row(text: str) -> int:
    """Exponentials of a softmax, and about as much work for a norm."""
    found = re.match(r"(softmax|layer_norm)\(.*, (\d+)\);", text)
    return 0 if found is None else int(found[2])
