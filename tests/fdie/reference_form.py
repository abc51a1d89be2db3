"""`fdie` written a second time, from paper 000 alone, in plain numpy: loops, estimates instead of residuals, no CasADi.

The continuous equations (17), (23), (26), (27), (31) and the filter F of (33) are discretised here by matrix
exponentials; the set-membership extension follows its definition in the README. Where the two forms are algebraically
equal they must agree to rounding.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace

import numpy as np
from scipy.linalg import expm


def allocation(vehicle):
    """M of (10), from the positions of the rotors about the centre of mass."""
    matrix = np.zeros((4, 4))
    for i in range(4):
        b, k = vehicle.thrust_coefficient[i], vehicle.torque_coefficient[i]
        x, y = vehicle.rotor_x[i] - vehicle.centre_of_mass[0], vehicle.rotor_y[i] - vehicle.centre_of_mass[1]
        matrix[:, i] = [b, -b * y, b * x, vehicle.rotor_direction[i] * k]
    return matrix


def input_gain(euler, vehicle):
    """Diagonal of G in (14)."""
    jx, jy, jz = vehicle.inertia
    return np.array([-np.cos(euler[0]) * np.cos(euler[1]) / vehicle.mass, 1 / jx, 1 / jy, 1 / jz])


def coupling(rate, rotor_speed, vehicle):
    """Rows 2 to 4 of phi in (15), corrected, with the rotors' gyroscopic torque as xi_0."""
    (jx, jy, jz), (p, q, r) = vehicle.inertia, rate
    momentum = -vehicle.rotor_inertia * np.sum(vehicle.rotor_direction * rotor_speed)
    return np.array(
        [(jy - jz) / jx * q * r - q * momentum / jx, (jz - jx) / jy * p * r + p * momentum / jy, (jx - jy) / jz * p * q]
    )


@cache
def held(rates, dt):
    """(a, b) of x+ = a x + b u for x' = -rate x + u and a tuple of rates, by matrix exponentials."""
    blocks = [expm(np.array([[-rate, 1.0], [0.0, 0.0]]) * dt) for rate in rates]
    return np.array([block[0, 0] for block in blocks]), np.array([block[0, 1] for block in blocks])


class VerticalFilter:
    """F(s) = w0^2 / (s + w0)^2 on several signals; returns the means of its outputs over the step."""

    def __init__(self, bandwidth, dt, values):
        w = bandwidth
        transition = expm(np.array([[0, 1, 0], [-w * w, -2 * w, w * w], [0, 0, 0.0]]) * dt)
        self.own, self.driven = transition[:2, :2], transition[:2, 2:]
        self.state = np.array([values, np.zeros(len(values))])

    def __call__(self, values):
        before = self.state
        self.state = self.own @ before + self.driven * values
        return (before[0] + self.state[0]) / 2


class ReferenceFdie:
    """The diagnoser; `sample` takes one sample and returns the outputs by name."""

    def __init__(self, parameters: SimpleNamespace, vehicle: SimpleNamespace, dt: float):
        self.p, self.vehicle, self.dt = parameters, vehicle, dt
        self.detection_hold = held(tuple(parameters.observer_gain), dt)
        self.isolation_hold = held(tuple(parameters.isolation_gain), dt)
        self.matrix = allocation(vehicle)
        self.first_time = None
        self.detected = False
        self.times = {"detection_time": np.nan, "paper_isolation_time": np.nan, "set_isolation_time": np.nan}
        self.rotor = {"paper": 0, "set": 0}
        self.alone_since = {"paper": None, "set": None}
        self.restart_isolation(np.zeros(4))

    def restart_isolation(self, zeta):
        """State of the isolation estimators and sets at T_d."""
        self.zeta_hat_s = np.tile(zeta, (4, 1))
        self.mu = np.tile(self.p.isolation_noise_floor, (4, 1)).astype(float)
        self.theta_hat = np.full(4, self.p.loe_max)
        self.paper_excluded = np.zeros(4, bool)
        self.zeta_hat_set = zeta.copy()
        self.set_bound = np.array(self.p.detection_noise_floor, float)
        self.H, self.S = np.zeros((4, 4)), np.zeros((4, 4))  # [rotor, channel]
        self.lower, self.upper = np.zeros(4), np.full(4, self.p.loe_max)
        self.set_excluded = np.zeros(4, bool)
        self.evidence, self.information = np.zeros(4), np.zeros(4)

    def sample(self, time, command, euler, rate, vertical_velocity):
        zeta = np.array([vertical_velocity, *rate])
        if self.first_time is None:
            self.first_time, self.zeta = time, zeta
            self.speed, self.old_speed = command.copy(), command.copy()
            self.filter = None
            f, h, old, bound = self.known(command, euler, zeta)
            self.zeta_hat = zeta.copy()
            self.bound = bound / self.p.observer_gain + 0.003 * abs(h).sum(axis=0)
        else:
            f, h, old, bound = self.known(command, euler, zeta)
            self.detection_step(zeta, f, bound)
            if self.detected:
                self.isolation_step(zeta, f, h, bound)
                self.set_step(zeta, f, h, old, bound)
        self.decide(time, zeta)
        self.zeta = zeta
        return self.outputs(time, zeta)

    def known(self, command, euler, zeta):
        """Means over the step of f, h_s [rotor, channel], what lags remember of h_s, and the bound."""
        v, p, dt = self.vehicle, self.p, self.dt
        a = np.exp(-dt / v.motor_time_constant)
        speed = a * self.speed + (1 - a) * command
        if self.detected:
            a = np.exp(-dt / (p.motor_lag_margin * v.motor_time_constant))
            old_speed = a * self.old_speed + (1 - a) * 1e-3
        else:
            old_speed = speed.copy()
        mean, mean_old = (self.speed + speed) / 2, (self.old_speed + old_speed) / 2
        self.speed, self.old_speed = speed, old_speed

        middle = (self.zeta + zeta) / 2
        G = input_gain(euler, v)
        u = G * (self.matrix @ mean**2)
        phi = np.array([v.gravity, *coupling(middle[1:], mean, v)]) + p.offset
        f = phi + u
        h = np.array([-G * self.matrix[:, s] * mean[s] ** 2 for s in range(4)])
        old = np.array([-G * self.matrix[:, s] * mean[s] * mean_old[s] for s in range(4)])
        hover = np.array([v.gravity, 0, 0, 0])
        transient = G * (self.matrix @ command**2) - u
        bound = p.bound_constant + p.bound_slope * abs(u + hover) + p.bound_transient_slope * abs(transient)

        vertical = np.array([f[0], bound[0], *h[:, 0], *old[:, 0]])
        self.filter = self.filter or VerticalFilter(p.velocity_filter_bandwidth, dt, vertical)
        vertical = self.filter(vertical)
        f[0] = vertical[0] - v.drag_coefficient / v.mass * middle[0]
        bound[0] = vertical[1]
        h[:, 0], old[:, 0] = vertical[2:6], vertical[6:10]
        return f, h, old, bound

    def corrected(self, estimate, zeta, f, hold):
        """zeta_hat after the step: from the error a e + b ((zeta+ - zeta) / dt - f)."""
        a, b = hold
        return zeta - (a * (self.zeta - estimate) + b * ((zeta - self.zeta) / self.dt - f))

    def detection_step(self, zeta, f, bound):
        a, b = self.detection_hold
        self.zeta_hat = self.corrected(self.zeta_hat, zeta, f, self.detection_hold)
        self.bound = a * self.bound + b * bound

    def isolation_step(self, zeta, f, h, bound):
        a, b = self.isolation_hold
        for s in range(4):
            theta = self.theta_hat[s]
            kappa = max(theta, self.p.loe_max - theta)
            gradient = self.p.learning_rate * (h[s] @ (self.zeta - self.zeta_hat_s[s]))
            self.zeta_hat_s[s] = self.corrected(self.zeta_hat_s[s], zeta, f + theta * h[s], self.isolation_hold)
            self.mu[s] = a * self.mu[s] + b * (kappa * abs(h[s]) + bound)
            self.theta_hat[s] = min(max(theta + self.dt * gradient, 0), self.p.loe_max)

    def set_step(self, zeta, f, h, old, bound):
        p, (a, b) = self.p, self.detection_hold
        self.zeta_hat_set = self.corrected(self.zeta_hat_set, zeta, f, self.detection_hold)
        self.set_bound = a * self.set_bound + b * bound
        e, width = zeta - self.zeta_hat_set, self.set_bound + p.detection_noise_floor
        forget = np.exp(-self.dt / p.estimate_memory_time)
        for s in range(4):
            self.H[s] = a * self.H[s] + b * h[s]
            self.S[s] = a * self.S[s] + b * old[s]
            expected = (self.H[s] - self.S[s] / 2) / (width + 1e-9)
            self.evidence[s] = forget * self.evidence[s] + expected @ (e / (width + 1e-9))
            self.information[s] = forget * self.information[s] + expected @ expected
            towards, full = e * np.sign(self.H[s]), abs(self.H[s])
            certain = full - abs(self.S[s])
            if not self.set_excluded[s]:
                self.lower[s] = max(self.lower[s], *((towards - width) / full)[full > 1e-9])
                self.upper[s] = min(self.upper[s], *((towards + width) / certain)[certain > 1e-9])
        self.set_excluded |= self.lower > self.upper

    def decide(self, time, zeta):
        p = self.p
        if self.detected:
            error = zeta - self.zeta_hat_s
            self.paper_excluded |= (abs(error) > self.mu + p.isolation_noise_floor).any(axis=1)
            self.name("paper", "paper_isolation_time", self.paper_excluded, 0.0, time)
            self.name("set", "set_isolation_time", self.set_excluded, p.dwell_time, time)
        elif time - self.first_time > p.warm_up_time - self.dt / 2 and self.exceeds(zeta):
            self.detected, self.times["detection_time"] = True, time
        if self.times["detection_time"] == time or not self.detected:
            self.restart_isolation(zeta)

    def exceeds(self, zeta):
        return (abs(zeta - self.zeta_hat) > self.bound + self.p.detection_noise_floor).any()

    def name(self, rule, time_name, excluded, dwell, time):
        left = np.flatnonzero(~excluded)
        if len(left) <= 1 and self.alone_since[rule] is None:
            self.alone_since[rule] = time
        if self.rotor[rule] == 0 and len(left) == 0:
            self.rotor[rule] = -1
        elif self.rotor[rule] == 0 and len(left) == 1 and time - self.alone_since[rule] > dwell - self.dt / 2:
            self.rotor[rule] = left[0] + 1
            self.times[time_name] = time

    def outputs(self, time, zeta):
        p, by_sets = self.p, self.p.isolation_rule == 1
        rotor = self.rotor["set" if by_sets else "paper"]
        estimate = self.theta_hat
        if by_sets:
            least_squares = self.evidence / np.maximum(self.information, 1e-9)
            cut = np.minimum(np.maximum(least_squares, self.lower), self.upper)
            estimate = np.where(self.set_excluded, least_squares, cut)
        named = np.arange(1, 5) == rotor
        none_left = np.nan if self.set_excluded[named].any() else 0.0
        warm = time - self.first_time > p.warm_up_time - self.dt / 2
        return {
            "fault_detected": self.detected,
            "faulty_rotor": rotor,
            "loe_estimate": np.where(named, estimate, 0),
            "detection_time": self.times["detection_time"],
            "isolation_time": self.times["set_isolation_time" if by_sets else "paper_isolation_time"],
            "residual": zeta - self.zeta_hat,
            "threshold": self.bound + p.detection_noise_floor if warm else np.full(4, np.nan),
            "isolation_residual": (zeta - self.zeta_hat_s).ravel(),
            "isolation_threshold": (self.mu + p.isolation_noise_floor).ravel(),
            "excluded": self.paper_excluded,
            "paper_rotor": self.rotor["paper"],
            "paper_isolation_time": self.times["paper_isolation_time"],
            "set_lower": self.lower,
            "set_upper": self.upper,
            "set_excluded": self.set_excluded,
            "set_rotor": self.rotor["set"],
            "set_isolation_time": self.times["set_isolation_time"],
            "fie_loe_estimate": self.theta_hat if self.detected else np.zeros(4),
            "loe_lower": self.lower[named].sum() + none_left,
            "loe_upper": self.upper[named].sum() + none_left,
        }
