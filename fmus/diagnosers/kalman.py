"""Kalman filters that estimate states and losses jointly, as symbolic steps of which nothing is computed twice.

Both work on x+ = A x + b + E gamma + w, gamma+ = gamma + w_gamma, y = C x + v. `augmented_step` is the Kalman filter
of [x; gamma]; `staged_step` is the optimal two-stage filter (Hsieh, Chen 1999), which equals it. Covariances are
symmetric: of every product the upper triangle is kept and mirrored, so that CasADi drops what the lower one would cost,
as it drops the structural zeros of A, E and C. The errors of measurements are independent, so that one is taken after
the other: innovations are scalars.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from casadi import SX, Sparsity, blockcat, diagcat, horzcat, ldl, ldl_solve, sqrt, triu, triu2symm, vertcat

from rotordx.fmus.shell.ports import Scalar, Vector


@dataclass(frozen=True)
class Model:
    """One step with n states, m losses and p measurements; w, w_gamma and v are white and independent."""

    transition: SX  #: A (n, n)
    drive: SX  #: b (n), what the known inputs add
    loss_input: SX  #: E (n, m), -B diag(u) of the paper
    measurement: SX  #: C (p, n)
    process_noise: SX  #: covariance Q_x (n, n) of w
    loss_noise: SX  #: covariance Q_gamma (m, m) of w_gamma
    measurement_noise: SX  #: variances (p) of v, R = diag


@dataclass(frozen=True)
class Innovation:
    """What each scalar measurement adds to those before it, so that the elements are independent."""

    error: SX  #: (p) measurement less prediction
    variance: SX  #: (p) of that error, as the filter has it

    @property
    def normalised(self) -> SX:
        """Errors (p) in standard deviations; their sum of squares is the normalised innovation squared."""
        return self.error / sqrt(self.variance)


@dataclass(frozen=True)
class Augmented:
    """Estimate of [x; gamma] and its covariance."""

    state: SX  #: (n)
    loss: SX  #: (m)
    covariance: SX  #: (n + m, n + m)

    @property
    def loss_covariance(self) -> SX:
        """Of the losses (m, m)."""
        n = self.state.numel()
        return self.covariance[n:, n:]

    @property
    def state_covariance(self) -> SX:
        """Of the states (n, n)."""
        n = self.state.numel()
        return self.covariance[:n, :n]


@dataclass(frozen=True)
class Staged:
    """Bias-free estimate x~, losses gamma, and the coupling V between them: x = x~ + V gamma."""

    bias_free_state: SX  #: x~ (n)
    bias_free_covariance: SX  #: P~ (n, n)
    loss: SX  #: gamma (m)
    loss_covariance: SX  #: P_gamma (m, m)
    coupling: SX  #: V (n, m)

    @property
    def state(self) -> SX:
        """Estimate of x (n)."""
        return self.bias_free_state + self.coupling @ self.loss

    @property
    def state_covariance(self) -> SX:
        """P~ + V P_gamma V' (n, n)."""
        return self.bias_free_covariance + self.coupling @ self.loss_covariance @ self.coupling.T


def pack(symmetric: SX) -> SX:
    """Upper triangle of a symmetric matrix (n, n) by columns, (n (n + 1) / 2)."""
    return vertcat(*(symmetric[: j + 1, j] for j in range(symmetric.shape[0])))


def unpack(packed: SX, n: int) -> SX:
    """The symmetric matrix (n, n) that `pack` was given."""
    return triu2symm(SX(Sparsity.upper(n), SX(packed)))


def augmented_step(before: Augmented, model: Model, measured: Vector) -> tuple[Augmented, Innovation]:
    """Augmented-state Kalman filter: prediction over a step, then the measurement (p) at its end."""
    n, m = model.loss_input.shape
    transition = blockcat([[model.transition, model.loss_input], [SX(m, n), SX.eye(m)]])
    joint = transition @ vertcat(before.state, before.loss) + vertcat(model.drive, SX(m, 1))
    noise = diagcat(model.process_noise, model.loss_noise)
    covariance = _mirrored(transition @ before.covariance @ transition.T + noise)
    errors, variances = [], []
    for row, noise_variance, value in _scalars(model, measured, n + m):
        gain, column, variance = _scalar_gain(covariance, row, noise_variance)
        error = value - row @ joint
        joint = joint + gain * error
        covariance = _mirrored(covariance - gain @ column.T)
        errors.append(error)
        variances.append(variance)
    return Augmented(joint[:n], joint[n:], covariance), Innovation(vertcat(*errors), vertcat(*variances))


def staged_step(before: Staged, model: Model, measured: Vector) -> tuple[Staged, Innovation]:
    """Multi-stage joint observer: bias-free filter, filter of the losses on its residual, coupling between them.

    D = W Q_gamma (P_gamma + Q_gamma)^-1 is the part of the coupling W that the losses' random walk undoes; it corrects
    mean and covariance of the bias-free stage. Without it the filter is Friedland's, optimal for constant losses only.
    """
    n = model.loss_input.shape[0]
    W = model.transition @ before.coupling + model.loss_input
    loss_covariance = _mirrored(before.loss_covariance + model.loss_noise)
    correction = W @ _solved(loss_covariance, model.loss_noise).T
    state = model.transition @ before.bias_free_state + model.drive + correction @ before.loss
    covariance = _mirrored(
        model.transition @ before.bias_free_covariance @ model.transition.T
        + model.process_noise
        + correction @ before.loss_covariance @ W.T
    )
    after = Staged(state, covariance, before.loss, loss_covariance, W - correction)
    errors, variances = [], []
    for row, noise_variance, value in _scalars(model, measured, n):
        gain, column, variance = _scalar_gain(after.bias_free_covariance, row, noise_variance)
        after, error, total = _scalar_stage(after, gain, variance, row, value)
        after = replace(after, bias_free_covariance=_mirrored(after.bias_free_covariance - gain @ column.T))
        errors.append(error)
        variances.append(total)
    return after, Innovation(vertcat(*errors), vertcat(*variances))


def fixed_augmented_step(before: Augmented, model: Model, measured: Vector, gain: SX) -> tuple[Augmented, SX]:
    """The augmented filter with a gain K (n + m, p) computed beforehand; its covariance stays as it is.

    Returns:
        the estimate, and the errors (p) of the prediction.
    """
    n = model.loss_input.shape[0]
    state = model.transition @ before.state + model.loss_input @ before.loss + model.drive
    error = measured - model.measurement @ state
    correction = gain @ error
    return replace(before, state=state + correction[:n], loss=before.loss + correction[n:]), error


def fixed_staged_step(
    before: Staged, model: Model, measured: Vector, gain: SX, variance: Vector
) -> tuple[Staged, Innovation]:
    """Friedland's separate-bias filter: the bias-free gain K~ (n, p) and the variances (p) of its innovation are held.

    D is left out with the covariance that it belongs to; the covariance of the bias-free stage stays as it is.
    """
    W = model.transition @ before.coupling + model.loss_input
    state = model.transition @ before.bias_free_state + model.drive
    residual = measured - model.measurement @ state
    H = model.measurement @ W
    after = replace(before, loss_covariance=_mirrored(before.loss_covariance + model.loss_noise))
    errors, variances = [], []
    for i in range(residual.numel()):
        after, error, total = _loss_stage(after, residual[i], H[i, :], variance[i])
        errors.append(error)
        variances.append(total)
    after = replace(after, bias_free_state=state + gain @ residual, coupling=W - gain @ H)
    return after, Innovation(vertcat(*errors), vertcat(*variances))


def _scalars(model: Model, measured: Vector, width: int) -> list[tuple[SX, Scalar, Scalar]]:
    """(row of C filled up with zeros to a width, noise variance, value) of each measurement."""
    p, n = model.measurement.shape
    C = horzcat(model.measurement, SX(p, width - n))
    return [(C[i, :], model.measurement_noise[i], measured[i]) for i in range(p)]


def _scalar_gain(covariance: SX, row: SX, noise_variance: Scalar) -> tuple[SX, SX, Scalar]:
    """Kalman gain, covariance of all states with the prediction of one measurement, variance of its innovation."""
    column = covariance @ row.T
    variance = row @ column + noise_variance
    return column / variance, column, variance


def _scalar_stage(before: Staged, gain: SX, variance: Scalar, row: SX, value: Scalar) -> tuple[Staged, Scalar, Scalar]:
    """Both stages take one measurement; the bias-free gain and innovation variance are given."""
    residual = value - row @ before.bias_free_state
    H = row @ before.coupling
    after, error, total = _loss_stage(before, residual, H, variance)
    state = before.bias_free_state + gain * residual
    return replace(after, bias_free_state=state, coupling=before.coupling - gain @ H), error, total


def _loss_stage(before: Staged, residual: Scalar, H: SX, variance: Scalar) -> tuple[Staged, Scalar, Scalar]:
    """The losses take one bias-free residual, r = H gamma + white noise of the variance given."""
    gain, column, total = _scalar_gain(before.loss_covariance, H, variance)
    error = residual - H @ before.loss
    covariance = _mirrored(before.loss_covariance - gain @ column.T)
    return replace(before, loss=before.loss + gain * error, loss_covariance=covariance), error, total


def _mirrored(matrix: SX) -> SX:
    """A matrix that is symmetric but for rounding, of its upper triangle alone: the lower one is not computed."""
    return triu2symm(triu(matrix))


def _solved(symmetric: SX, right: SX) -> SX:
    """Solution X of symmetric X = right, by factors L D L'."""
    return ldl_solve(right, *ldl(symmetric))
