"""What a step of each form of the joint filter costs: operations, and time as compiled C.

All are symbolic functions of dense matrices, so that they differ in nothing but the form. CasADi has dropped what is
computed twice; what a form computes needlessly (zeros of the augmented matrix, both triangles) it computes here too.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from casadi import SX

from rotordx.fmus.diagnosers import kalman
from rotordx.fmus.diagnosers.c99 import strict_source

COMPILER = "cc"
CALLS, ROUNDS = 2000, 7

#: instructions that are no arithmetic
_MOVES = (ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, ca.OP_ASSIGN)


def model_of(n: int, m: int, p: int) -> tuple[kalman.Model, list[SX]]:
    """A model of symbols without structural zeros but in the covariances of losses and measurements; its symbols.

    Those are A, b, E, C, packed Q, diagonals of Q_gamma and R.
    """
    A, b, E, C = SX.sym("A", n, n), SX.sym("b", n), SX.sym("E", n, m), SX.sym("C", p, n)
    Q, Q_gamma, R = SX.sym("Q", n * (n + 1) // 2), SX.sym("G", m), SX.sym("R", p)
    return kalman.Model(A, b, E, C, kalman.unpack(Q, n), ca.diag(Q_gamma), R), [A, b, E, C, Q, Q_gamma, R]


def augmented(n: int, m: int, p: int, *, fixed_gain: bool = False) -> ca.Function:
    """Block-structured ASKF: (X, packed P, model, y[, K]) -> (X, packed P, normalised innovation)."""
    model, symbols = model_of(n, m, p)
    X, P, y = SX.sym("X", n + m), SX.sym("P", (n + m) * (n + m + 1) // 2), SX.sym("y", p)
    before = kalman.Augmented(X[:n], X[n:], kalman.unpack(P, n + m))
    if fixed_gain:
        K = SX.sym("K", n + m, p)
        after, _ = kalman.fixed_augmented_step(before, model, y, K)
        return _function("augmented_fixed", [X, *symbols, y, K], [ca.vertcat(after.state, after.loss)])
    after, innovation = kalman.augmented_step(before, model, y)
    results = [ca.vertcat(after.state, after.loss), kalman.pack(after.covariance), innovation.normalised]
    return _function("augmented", [X, P, *symbols, y], results)


def staged(n: int, m: int, p: int, *, fixed_gain: bool = False) -> ca.Function:
    """Multi-stage observer: (x~, packed P~, gamma, packed P_gamma, V, model, y[, K~, S~]) -> (x~, ..., innovation)."""
    model, symbols = model_of(n, m, p)
    x, P, y = SX.sym("x", n), SX.sym("P", n * (n + 1) // 2), SX.sym("y", p)
    gamma, P_gamma, V = SX.sym("gamma", m), SX.sym("P_gamma", m * (m + 1) // 2), SX.sym("V", n, m)
    before = kalman.Staged(x, kalman.unpack(P, n), gamma, kalman.unpack(P_gamma, m), V)
    arguments, name = [x, P, gamma, P_gamma, V, *symbols, y], "staged"
    if fixed_gain:
        K, S = SX.sym("K", n, p), SX.sym("S", p)
        after, innovation = kalman.fixed_staged_step(before, model, y, K, S)
        arguments, name = [*arguments, K, S], "staged_fixed"
    else:
        after, innovation = kalman.staged_step(before, model, y)
    results = [
        after.bias_free_state,
        kalman.pack(after.bias_free_covariance),
        after.loss,
        kalman.pack(after.loss_covariance),
        after.coupling,
        innovation.normalised,
    ]
    return _function(name, arguments, results)


def dense_augmented(n: int, m: int, p: int, *, symmetric: bool = False, information: bool = False) -> ca.Function:
    """ASKF by whole matrices: (X, P, F, b, H, Q, R, y) -> (X, P).

    Args:
        symmetric: only the upper triangles of the covariances are computed.
        information: the covariance is updated as the paper prints it, by the inverses of both.
    """
    size = n + m
    mirrored = (lambda a: ca.triu2symm(ca.triu(a))) if symmetric else (lambda a: a)
    X, F, b, H, y = SX.sym("X", size), SX.sym("F", size, size), SX.sym("b", size), SX.sym("H", p, size), SX.sym("y", p)
    P, Q, R = SX.sym("P", size, size), SX.sym("Q", size, size), SX.sym("R", p, p)
    covariance = mirrored(F @ mirrored(P) @ F.T + Q)
    output = H @ covariance
    gain = _solved(mirrored(output @ H.T + R), output).T
    state = F @ X + b
    state = state + gain @ (y - H @ state)
    after = mirrored(covariance - gain @ output)
    if information:
        after = _solved(_solved(covariance, SX.eye(size)) + H.T @ _solved(R, H), SX.eye(size))
    name = "information" if information else "symmetric" if symmetric else "dense"
    return _function(f"augmented_{name}", [X, P, F, b, H, Q, R, y], [state, after])


def dense_staged(n: int, m: int, p: int) -> ca.Function:
    """Multi-stage observer by whole matrices, as printed: (x~, P~, gamma, P_gamma, V, model, y) -> (first five, x)."""
    A, b, E, C, y = SX.sym("A", n, n), SX.sym("b", n), SX.sym("E", n, m), SX.sym("C", p, n), SX.sym("y", p)
    Q, Q_gamma, R = SX.sym("Q", n, n), SX.sym("G", m, m), SX.sym("R", p, p)
    x, P, gamma = SX.sym("x", n), SX.sym("P", n, n), SX.sym("gamma", m)
    P_gamma, V = SX.sym("P_gamma", m, m), SX.sym("V", n, m)
    W = A @ V + E
    predicted = P_gamma + Q_gamma
    coupling = W @ P_gamma @ _solved(predicted, SX.eye(m))
    state = A @ x + b + W @ gamma - coupling @ gamma
    covariance = A @ P @ A.T + Q + W @ P_gamma @ W.T - coupling @ predicted @ coupling.T
    output = C @ covariance
    S = output @ C.T + R
    gain = _solved(S, output).T
    residual = y - C @ state
    output_loss = C @ coupling
    loss_output = output_loss @ predicted
    loss_gain = _solved(loss_output @ output_loss.T + S, loss_output).T
    loss = gamma + loss_gain @ (residual - output_loss @ gamma)
    after_coupling = coupling - gain @ output_loss
    after = state + gain @ residual
    results = [
        after,
        covariance - gain @ output,
        loss,
        predicted - loss_gain @ loss_output,
        after_coupling,
        after + after_coupling @ loss,
    ]
    return _function("staged_dense", [x, P, gamma, P_gamma, V, A, b, E, C, Q, Q_gamma, R, y], results)


#: what is compared, from the printed baseline on
FORMS: dict[str, Callable[[int, int, int], ca.Function]] = {
    "ASKF, information form as printed": lambda n, m, p: dense_augmented(n, m, p, information=True),
    "ASKF, dense": dense_augmented,
    "ASKF, dense and symmetric": lambda n, m, p: dense_augmented(n, m, p, symmetric=True),
    "ASKF, block-structured (`askf`)": augmented,
    "multi-stage, dense as printed": dense_staged,
    "multi-stage, symmetric (`msjfo`)": staged,
    "ASKF, fixed gain": lambda n, m, p: augmented(n, m, p, fixed_gain=True),
    "multi-stage, fixed gain (Friedland)": lambda n, m, p: staged(n, m, p, fixed_gain=True),
}


def operations(function: ca.Function) -> int:
    """Number of additions, multiplications, divisions and roots in one call."""
    return sum(function.instruction_id(k) not in _MOVES for k in range(function.n_instructions()))


class Compiled:
    """A CasADi function compiled as the diagnosers are; arrays in, arrays out.

    Raises:
        subprocess.CalledProcessError: the compiler failed.
    """

    def __init__(self, function: ca.Function, folder: Path, dtype: Any = np.float64, optimise: str = "-O1"):
        name = function.name()
        folder.mkdir(parents=True, exist_ok=True)
        generator = ca.CodeGenerator(name, {"casadi_int": "int"})
        generator.add(function)
        generator.generate(f"{folder}/")
        source = folder / f"{name}.c"
        source.write_text(strict_source(source.name, source.read_text()) + _REPEATED.format(name=name))
        single = ["-DROTORDX_SINGLE"] if dtype == np.float32 else []
        flags = [optimise, "-ffp-contract=off", "-shared", "-fPIC", *single]
        subprocess.run([COMPILER, *flags, "-o", f"{name}.so", source.name, "-lm"], check=True, cwd=folder)
        self._repeat = ctypes.CDLL(str(folder / f"{name}.so")).repeated
        self._repeat.argtypes = [ctypes.c_int] + [ctypes.c_void_p] * 4
        self._inputs = [np.zeros(function.numel_in(i), dtype) for i in range(function.n_in())]
        self._outputs = [np.zeros(function.numel_out(i), dtype) for i in range(function.n_out())]
        work = [np.zeros(function.sz_iw() + 1, np.intc), np.zeros(function.sz_w() + 1, dtype)]
        self._memory = [*work, _pointers(self._inputs), _pointers(self._outputs)]
        self._arguments = (self._memory[2], self._memory[3], work[0].ctypes.data, work[1].ctypes.data)

    def __call__(self, *values: Any) -> list[np.ndarray]:
        """Outputs as flat arrays; matrices by columns, as inputs too."""
        for array, value in zip(self._inputs, values, strict=True):
            array[:] = np.asarray(value).ravel(order="F")
        self._repeat(1, *self._arguments)
        return [output.copy() for output in self._outputs]

    def seconds(self) -> float:
        """CPU time of one call with the inputs of the last one: the best of some rounds."""
        times = []
        for _ in range(ROUNDS):
            begin = time.process_time()
            self._repeat(CALLS, *self._arguments)
            times.append((time.process_time() - begin) / CALLS)
        return min(times)


_REPEATED = """
void repeated(int calls, const casadi_real** arg, casadi_real** res, int* iw, casadi_real* w);
void repeated(int calls, const casadi_real** arg, casadi_real** res, int* iw, casadi_real* w) {{
  for (int i = 0; i < calls; ++i) {name}(arg, res, iw, w, 0);
}}
"""


def measured_seconds(function: ca.Function, folder: Path) -> float | None:
    """CPU time of a step of a form in C, None if there is no compiler; well-conditioned numbers stand for matrices."""
    if shutil.which(COMPILER) is None:
        return None
    compiled = Compiled(function, folder)
    compiled(*(_plausible(*function.size_in(i)) for i in range(function.n_in())))
    return compiled.seconds()


def _plausible(rows: int, columns: int) -> np.ndarray:
    """A unit matrix with small numbers everywhere; as a packed triangle it is positive definite, too."""
    if rows == columns:
        return np.eye(rows) + 0.01
    packed = round((np.sqrt(8 * rows + 1) - 1) / 2)
    if columns == 1 and packed * (packed + 1) // 2 == rows and rows > 1:
        return np.concatenate([(np.eye(packed) + 0.01)[: j + 1, j] for j in range(packed)])
    return np.full((rows, columns), 0.1)


def _pointers(arrays: list[np.ndarray]) -> Any:
    return (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))


def _solved(symmetric: SX, right: SX) -> SX:
    return ca.ldl_solve(right, *ca.ldl(symmetric))


def _function(name: str, arguments: list[SX], results: list[SX]) -> ca.Function:
    return ca.Function(name, arguments, [ca.densify(r) for r in results], {"cse": True})
