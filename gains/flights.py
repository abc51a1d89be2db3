"""A flight as identification and replay see it: what every diagnoser is fed, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Flight:
    """Uninterrupted samples of a diagnoser's inputs on its grid; SI units, NED and FRD axes.

    Sample k pairs the measurements at `time[k]` with the command that acted over the step that ends there.
    """

    name: str  #: what messages call it: a file, a scenario and a seed
    time: NDArray[np.float64]  #: (N,) s, uniform
    rotor_speed_command: NDArray[np.float64]  #: (N, 4) rad/s
    euler: NDArray[np.float64]  #: (N, 3) rad: roll, pitch, yaw
    body_rate: NDArray[np.float64]  #: (N, 3) rad/s: p, q, r
    vertical_velocity: NDArray[np.float64]  #: (N,) m/s, down positive, filtered by (33) of the fdie paper

    @property
    def step_size(self) -> float:
        """Time between samples, s."""
        return float(self.time[-1] - self.time[0]) / (len(self.time) - 1)

    @property
    def inputs(self) -> NDArray[np.float64]:
        """(N, 11) inputs in the order of a diagnoser's ports."""
        return np.column_stack((self.rotor_speed_command, self.euler, self.body_rate, self.vertical_velocity))
