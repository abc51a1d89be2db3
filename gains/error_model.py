"""Error dynamics of an observer for state and fault, linear but for a Lipschitz term: what a certificate is about."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from rotordx.gains.inequalities import identity


@dataclass(frozen=True)
class ObserverGain:
    """Gain of an observer z_hat' = A z_hat + ... + L (y - C z_hat), z = [state; fault].

    With several injections the observer moves among them (an adapted gain); all obey one certificate. Where the fault
    estimate also follows the measurement directly, it is the fault part of z_hat plus `direct` (y - C z_hat).
    """

    injections: tuple[Any, ...]  #: each (n, p), L
    direct: Any  #: (n, p), zero in the rows of what is not a fault

    @classmethod
    def of(cls, *injections: Any) -> ObserverGain:
        """Gain without a direct part."""
        return cls(injections, 0 * injections[0])


@dataclass(frozen=True)
class ClosedLoop:
    """e' = A e + B w + D delta, |delta| <= lipschitz |N e|, z = C e + F w; floats or fractions."""

    A: Any
    B: Any
    C: Any
    D: Any
    F: Any
    N: Any
    lipschitz: Any


@dataclass(frozen=True)
class ErrorModel:
    """e' = (A - L C) e + D delta + E w - L V v, z = W e: open loop, before a gain closes it.

    `A` has one matrix per corner of what changes slowly and is known in flight (the tilt); w are the derivatives of
    the faults (or other disturbances), v the measurement noise, both scaled by E and V to unit size.
    """

    states: tuple[str, ...]  #: n names; faults are called `fault...`
    outputs: tuple[str, ...]  #: p names of what is measured
    A: tuple[Any, ...]  #: each (n, n)
    C: Any  #: (p, n)
    D: Any  #: (n, d), where the nonlinearity enters
    N: Any  #: (k, n), what it depends on
    lipschitz: float  #: 1/s
    E: Any  #: (n, m), disturbance input times size of the disturbances; last, of noise that drives a sensor's filter
    V: Any  #: (p, p), size of the measurement noise
    W: Any  #: (r, n), performance weights

    def close(self, gain: ObserverGain) -> Iterator[ClosedLoop]:
        """Closed loops of all corners with all injections."""
        C, F = self.performance(gain.direct)
        for L in gain.injections:
            for A in self.A:
                B = np.hstack((self.E, -1 * (L @ self.V)))
                yield ClosedLoop(A - L @ self.C, B, C, self.D, F, self.N, self.lipschitz)

    def performance(self, direct: Any) -> tuple[Any, Any]:
        """C and F of z = C e + F w, where part of the estimate follows the measurement directly."""
        C = self.W @ (identity(len(self.states)) - direct @ self.C)
        F = np.hstack((0 * (self.W @ self.E), -1 * (self.W @ direct @ self.V)))
        return C, F

    @property
    def faults(self) -> slice:
        """Where the faults lie among the states: they are the last ones."""
        count = sum(name.startswith("fault") for name in self.states)
        return slice(len(self.states) - count, len(self.states))

    @property
    def disturbances(self) -> int:
        """Number of inputs w: the columns of E, but for those of noise that drives a filter of the sensors."""
        filters = [name.startswith("filter") for name in self.states]
        return sum(not column[filters].any() for column in np.asarray(self.E).T)
