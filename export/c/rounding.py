"""Int8 for the matrix of a reservoir: rounded so that its products stay what they were.

A readout is solved for exactly these echoes, as a difference of large terms, and a reservoir's
activations move together. So each entry's error is made up for by those of its row that are not
rounded yet: least squares of the row's product over the activations (Frantar & Alistarh 2022,
Optimal Brain Compression). To the nearest integer, the error of the force grew by 6 % on the
gantry's test flights.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from export.c.interpreter import Interpreter, Wide
from export.c.program import Program
from export.c.weights import STEPS_OF_INT8, Matrix
from runtime.compiled.driven import driven
from wakedeploy.core.manifest import Manifest
from wakedeploy.core.onnx_graph import Graph

_DAMPING = 1e-3  # of the mean square of an activation: directions that the inputs did not show


def rounded_together(program: Program, graph: Graph, manifest: Manifest) -> Program:
    """The program with the integers of its sparse matrices chosen row by row."""
    if not any(matrix.is_sparse for matrix in program.matrices):
        return program
    exact, inputs = Interpreter(graph, manifest), driven(manifest)
    matrices = [
        replace(matrix, integers=_integers(matrix, exact.multiplied_by(matrix.tensor, inputs)))
        if matrix.is_sparse
        else matrix
        for matrix in program.matrices
    ]
    return replace(program, matrices=tuple(matrices))


def _integers(matrix: Matrix, activations: Wide) -> npt.NDArray[np.int8]:
    """All rows (outputs, inputs) for activations (T, inputs) that the matrix multiplies."""
    moments = activations.T @ activations / len(activations)  # (inputs, inputs)
    if not np.isfinite(moments).all():  # a package without sense: the gate will say so
        return matrix.stored("int8").astype(np.int8)
    made = np.zeros(matrix.weights.shape, np.int8)
    scales = matrix.scales("int8").astype(np.float64)
    for row, weights in enumerate(matrix.weights.astype(np.float64)):
        columns = np.flatnonzero(weights)
        if len(columns):
            among = moments[np.ix_(columns, columns)]
            made[row, columns] = _row(weights[columns] / scales[row], among)
    return made


def _row(wanted: Wide, moments: Wide) -> npt.NDArray[np.int8]:
    """Integers (n,) for wanted numbers (n,), one after the other."""
    little = _DAMPING * float(np.mean(np.diag(moments))) + 1e-12
    damped = moments + little * np.eye(len(moments))
    spread = np.linalg.cholesky(np.linalg.inv(damped)).T  # upper: how an error is made up for
    remainder = wanted.copy()
    for i in range(len(remainder)):
        whole = np.clip(np.rint(remainder[i]), -STEPS_OF_INT8, STEPS_OF_INT8)
        remainder[i:] -= (remainder[i] - whole) / spread[i, i] * spread[i, i:]
        remainder[i] = whole
    return remainder.astype(np.int8)
