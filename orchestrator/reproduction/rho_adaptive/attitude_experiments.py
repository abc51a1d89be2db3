"""The two faults of paper 003 on its attitude system: as printed, as they can be meant, and under its conditions."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rotordx.orchestrator.reproduction.rho_adaptive.attitude_system import (
    ARM,
    INERTIA,
    INITIAL_ERROR,
    NOISE,
    REACTION,
    SLIDING_RATE,
    UNCERTAINTY,
    WEIGHT,
    Flights,
    OfTorque,
    attitude_gain,
    simulate,
    tuned,
)

Array = NDArray[np.float64]

#: s from the onset on, over which errors are averaged
AFTER = 20.0

#: a modification norm N "slightly larger than the expected norm" of the fault
NORM_MARGIN = 1.2

#: whether there are (uncertainty, noise)
CONDITIONS = {"none": (False, False), "uncertainty": (True, False), "noise": (False, True), "both": (True, True)}


@dataclass(frozen=True)
class Experiment:
    """One flight with a fault theta, 0 before the onset."""

    onset: float  #: s
    size: float  #: theta in the end
    growth_rate: float  #: 1/s; infinite if abrupt
    regressor: OfTorque  #: phi
    condition: str = "both"
    learning_rate: float | None = None  #: gamma, 1/s2; None: the default of `tuned`
    modification_norm: float | None = None  #: N; None: slightly larger than the fault

    def fault(self, time: float) -> float:
        """Theta at a time."""
        return self.size * -float(np.expm1(-self.growth_rate * (time - self.onset))) if time > self.onset else 0.0


@dataclass(frozen=True)
class Outcome:
    """What came out of an experiment; (steps,) unless stated."""

    time: Array
    fault: Array
    estimate: dict[str, Array]  #: theta_hat by diagnoser
    residual: Array  #: J_nu, rad/s
    threshold: Array  #: J_th, rad/s
    detection_time: dict[str, float]  #: s, NaN if there was none
    onset: float  #: s

    def mean_squared_error(self, diagnoser: str) -> float:
        """Of theta_hat over `AFTER` from the onset on."""
        return self._mean((self.estimate[diagnoser] - self.fault) ** 2)

    def error_of_zero(self) -> float:
        """The same of an estimate that is always 0."""
        return self._mean(self.fault**2)

    def _mean(self, values: Array) -> float:
        return float(np.mean(values[(self.time > self.onset) & (self.time <= self.onset + AFTER)]))


def roll_torque(torque: Array) -> Array:
    """Phi (1, 3): theta times 0.8 N.m about x."""
    return np.array([[0.8, 0.0, 0.0]]) / INERTIA


def rotor_1(torque: Array) -> Array:
    """Phi (flights, 3): what the total loss of rotor 1, front left, takes away."""
    thrust = (WEIGHT + torque @ (1 / np.array([ARM, ARM, REACTION]))) / 4
    return np.asarray(-thrust[:, None] * np.array([ARM, ARM, REACTION]) / INERTIA)


def roll_acceleration(torque: Array) -> Array:
    """Phi (1, 3) if the printed numbers are angular accelerations: theta times 0.8 rad/s2 about x."""
    return np.array([[0.8, 0.0, 0.0]])


def roll_channel(torque: Array) -> Array:
    """Phi (flights, 3): theta is a loss of the torque about x."""
    return np.asarray(-torque * [1, 0, 0] / INERTIA)


def added_torque(torque: Array) -> Array:
    """Phi (1, 3): theta is added to the torque about x, N.m."""
    return np.array([[1.0, 0.0, 0.0]]) / INERTIA


#: the readings of the two faults that are flown on the vehicle, too
INCIPIENT = Experiment(onset=15.0, size=0.1, growth_rate=0.5, regressor=roll_torque)
ABRUPT = Experiment(onset=10.0, size=0.25, growth_rate=np.inf, regressor=rotor_1)


def experiments() -> dict[str, Experiment]:
    """All of them by name."""
    found = {}
    for condition in CONDITIONS:
        found[f"incipient, {condition}"] = replace(INCIPIENT, condition=condition)
        found[f"abrupt, {condition}"] = replace(ABRUPT, condition=condition)
    found |= {f"gamma {rate:g}": replace(ABRUPT, learning_rate=rate) for rate in (50.0, 100.0, 200.0)}
    found |= {f"N {norm:g}": replace(ABRUPT, modification_norm=norm) for norm in (0.05, 0.1, 0.2)}
    found["acceleration"] = replace(INCIPIENT, regressor=roll_acceleration)
    found["roll channel"] = replace(ABRUPT, regressor=roll_channel)
    found["added"] = replace(ABRUPT, regressor=added_torque, size=-0.25)
    return found


def outcomes(
    named: Mapping[str, Experiment],
    progress: Callable[[float], None] = lambda part: None,
    sliding_rate: float = SLIDING_RATE,
) -> dict[str, Outcome]:
    """Fly experiments, all at once; `sliding_rate` (1/s) is the speed of the sliding mode observer."""
    flown = list(named.values())
    present = np.array([CONDITIONS[e.condition] for e in flown], dtype=float)
    default_rate = float(np.linalg.norm(attitude_gain()[0], 2)) ** 2
    tuning = tuned(
        UNCERTAINTY,
        NOISE,
        INITIAL_ERROR,
        np.array([e.learning_rate or default_rate for e in flown]),
        np.array([e.modification_norm or NORM_MARGIN * abs(e.size) for e in flown]),
        sliding_rate,
    )

    rows = {e.regressor: [i for i, other in enumerate(flown) if other.regressor is e.regressor] for e in flown}

    def regressor(torque: Array) -> Array:
        phi = np.empty(torque.shape)
        for function, own in rows.items():
            phi[own] = function(torque[own])
        return phi

    def uncertainty(time: float) -> Array:
        direction = np.array([np.sin(0.7 * time), np.cos(1.1 * time), np.sin(1.9 * time + 1)])
        return UNCERTAINTY / np.sqrt(3) * present[:, :1] * direction

    flights = Flights(
        count=len(flown),
        regressor=regressor,
        fault=lambda time: np.array([[e.fault(time)] for e in flown]),
        uncertainty=uncertainty,
        noise=lambda time: NOISE / np.sqrt(3) * present[:, 1:] * np.full(3, np.sin(200 * time)),
    )
    found = simulate(flights, tuning, max(e.onset for e in flown) + AFTER, progress)
    return {
        name: Outcome(
            time=found.time,
            fault=found.fault[:, i],
            estimate={diagnoser: values[:, i] for diagnoser, values in found.estimate.items()},
            residual=found.residual[:, i],
            threshold=found.threshold[:, i],
            detection_time={diagnoser: float(values[i]) for diagnoser, values in found.detection_time.items()},
            onset=experiment.onset,
        )
        for i, (name, experiment) in enumerate(named.items())
    }
