"""Many flights at once in a world where the assumptions of paper 000 hold exactly: what its theorems are about.

The world is the discrete model that `fdie` believes in, with ideal sensors, a loss of effectiveness of one rotor from
some time on, and an uncertainty xi inside the bound that the test chooses freely, adversarially for instance.
Everything has one row per flight.
"""

from __future__ import annotations

import ctypes
import subprocess
from pathlib import Path

import numpy as np
from casadi import CodeGenerator, Function

from rotordx.fmus.diagnosers.fdie.step import Outputs, Parameters, State
from rotordx.fmus.shell.ports import flatten, start_values, table
from rotordx.fmus.vehicles import load_vehicle
from rotordx.fmus.vehicles.parameters import VehicleParameters
from tests.fdie.reference_form import allocation

DT = 0.002
FILTER_BANDWIDTH = 20.0
#: xi_bar of the world and of the diagnoser: about what is identified for lab_x
BOUND = {
    "bound_constant": np.array([0.25, 0.8, 0.8, 0.2]),
    "bound_slope": np.array([0.05, 0.03, 0.03, 0.05]),
    "bound_transient_slope": np.array([0.2, 0.1, 0.1, 0.2]),
}
#: ideal sensors: no noise floor, no warm-up
IDEAL = {"warm_up_time": 0.0, "offset": np.array([0.1, -0.3, 0.2, 0.05]), **BOUND}


def parameter_values(**changes) -> dict[str, np.ndarray]:
    """Parameters of `fdie` by name: start values, with changes."""
    values = {p.name: np.array(p.start) if p.shape else p.start[0] for p in table(Parameters)}
    assert set(changes) <= set(values)
    return values | changes


def constants(vehicle=None, **parameters) -> np.ndarray:
    """Argument p of the diagnoser's function: step size, vehicle (lab_x), parameters."""
    vehicle = vehicle or load_vehicle("lab_x").fill(VehicleParameters)
    values = parameter_values(**parameters)
    return np.concatenate([[DT], flatten(vehicle, stacked), flatten(Parameters(**values), stacked)])


def stacked(*values) -> np.ndarray:
    """Numbers and arrays as one vector."""
    return np.concatenate([np.atleast_1d(np.asarray(value, float)) for value in values])


def by_name(rows, cls) -> dict[str, np.ndarray]:
    """Ports of a class from rows of their values: (rows, size) each, (rows,) of a scalar port."""
    named, offset = {}, 0
    for p in table(cls):
        named[p.name] = rows[:, offset] if p.shape is None else rows[:, offset : offset + p.size]
        offset += p.size
    return named


class Compiled:
    """A diagnoser's CasADi function as compiled C, applied to many flights at once: arrays have a row per flight."""

    DRIVER = """
#include "step.h"
void sample(int flights, double* x, const double* u, const double* t, const double* p, double* y) {
  casadi_int iw[%(name)s_SZ_IW + 1];
  double w[%(name)s_SZ_W + 1], next[%(x)d];
  for (int i = 0; i < flights; ++i) {
    const double* arg[%(name)s_SZ_ARG] = {x + i * %(x)d, u + i * %(u)d, t + i, p + i * %(p)d};
    double* res[%(name)s_SZ_RES] = {next, y + i * %(y)d};
    %(name)s(arg, res, iw, w, 0);
    for (int j = 0; j < %(x)d; ++j) x[i * %(x)d + j] = next[j];
  }
}
"""

    def __init__(self, function: Function, folder: Path):
        folder.mkdir(parents=True, exist_ok=True)
        generator = CodeGenerator("step", {"with_header": True})
        generator.add(function)
        generator.generate(f"{folder}/")
        self.sizes = {name: function.numel_in(name) for name in ("x", "u", "t", "p")} | {"y": function.numel_out("y")}
        driver = self.DRIVER % (self.sizes | {"name": function.name()})
        (folder / "driver.c").write_text(driver)
        command = ["cc", "-O1", "-ffp-contract=off", "-shared", "-fPIC", "-o", "step.so", "step.c", "driver.c", "-lm"]
        subprocess.run(command, check=True, cwd=folder)
        self._sample = ctypes.CDLL(str(folder / "step.so")).sample

    def sample(self, x, u, t, p):
        """Advance x in place; outputs (flights, size)."""
        y = np.empty((len(x), self.sizes["y"]))
        arrays = [np.ascontiguousarray(array, float) for array in (u, t, p)]
        pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in (x, *arrays, y)]
        self._sample(len(x), *pointers)
        return y


class Diagnosers:
    """One `fdie` per flight, stepped together through the function that the FMU is generated from."""

    def __init__(self, flights: int, compiled: Compiled, **parameters):
        self.compiled = compiled
        self.x = np.tile(np.array(start_values(State)), (flights, 1))
        self.p = np.tile(constants(**parameters), (flights, 1))

    def sample(self, time, command, euler, zeta) -> dict[str, np.ndarray]:
        """Outputs by name after a sample; arguments are (flights, size)."""
        u = np.hstack([command, euler, zeta[:, 1:], zeta[:, :1]])
        y = self.compiled.sample(self.x, u, np.full(len(u), time), self.p)
        return by_name(y, Outputs)


class World:
    """Flights under random attitude motion and commands that keep the rates within a few rad/s."""

    def __init__(self, flights: int, seed: int, onset, rotor, loss, offset=IDEAL["offset"], bound=BOUND):
        self.vehicle = v = load_vehicle("lab_x").fill(VehicleParameters)
        self.rng = rng = np.random.default_rng(seed)
        self.onset, self.rotor, self.loss = onset, rotor, loss
        self.offset, self.bound_terms = offset, bound
        self.matrix = allocation(v)
        self.inverse = np.linalg.inv(self.matrix)
        self.amplitude = rng.uniform(0, 0.5, (flights, 3))
        self.rate = rng.uniform(0.3, 3.0, (flights, 3))
        self.phase = rng.uniform(0, 2 * np.pi, (flights, 3))
        self.push = rng.uniform(0, 6.0, (flights, 4)) * [0.3, 1, 1, 0.3]
        self.push_rate = rng.uniform(1.0, 20.0, (flights, 4))
        self.time = 0.0
        self.zeta = rng.uniform(-0.5, 0.5, (flights, 4))
        self.command = self._command()
        self.commanded = self.command.copy()  # lagged, of healthy rotors
        self.turning = self.command.copy()  # lagged, with the loss
        self.filter_value, self.filter_rate = self._drive(self.turning)[:, 0], np.zeros(flights)

    @property
    def euler(self):
        return self.amplitude * np.sin(self.rate * self.time + self.phase)

    def _gain(self):
        tilt = np.cos(self.euler[:, :1]) * np.cos(self.euler[:, 1:2])
        return np.hstack([-tilt / self.vehicle.mass, np.tile(1 / self.vehicle.inertia, (len(tilt), 1))])

    def _command(self):
        hover = np.array([-self.vehicle.gravity, 0, 0, 0])
        wanted = hover - 2 * self.zeta + self.push * np.sign(np.sin(self.push_rate * self.time + self.phase[:, :1]))
        squared = (wanted / self._gain()) @ self.inverse.T
        return np.sqrt(np.clip(squared, self.vehicle.rotor_speed_min**2, self.vehicle.rotor_speed_max**2))

    def _drive(self, speed):
        """Accelerations (flights, 4) at given rotor speeds, without the rates' coupling and the drag."""
        return self._gain() * (speed**2 @ self.matrix.T) + [self.vehicle.gravity, 0, 0, 0] + self.offset

    def _bound(self, lagged_speed):
        """xi_bar over the present step, before F."""
        lagged = self._gain() * (lagged_speed**2 @ self.matrix.T)
        transient = self._gain() * (self.command**2 @ self.matrix.T) - lagged
        effort = lagged + np.array([self.vehicle.gravity, 0, 0, 0])
        b = self.bound_terms
        return b["bound_constant"] + b["bound_slope"] * abs(effort) + b["bound_transient_slope"] * abs(transient)

    def advance(self, sign):
        """One step with xi = sign * xi_bar, |sign| <= 1 of shape (flights, 4): command, lags, loss, motion."""
        self.command = self._command()
        self.time = (round(self.time / DT) + 1) * DT
        effectiveness = np.ones_like(self.command)
        failed = self.time > self.onset + DT / 2
        effectiveness[failed, self.rotor[failed]] = np.sqrt(1 - self.loss[failed])
        healthy, self.commanded = self._lagged(self.commanded, self.command)
        actual, self.turning = self._lagged(self.turning, self.command * effectiveness)

        drive = self._drive(actual) + sign * self._bound(healthy) * (1 - 1e-9)
        drive[:, 0] = self._filtered(drive[:, 0])
        momentum = -self.vehicle.rotor_inertia * (healthy @ self.vehicle.rotor_direction)
        self.zeta = self._implicit_step(drive, momentum)

    def _lagged(self, speed, target):
        """(mean over the step, end of the step) of the rotor speeds."""
        decay = np.exp(-DT / self.vehicle.motor_time_constant)
        after = decay * speed + (1 - decay) * target
        return (speed + after) / 2, after

    def _filtered(self, target):
        """Mean of the velocity filter's output over the step, (33) without its differentiator."""
        w = FILTER_BANDWIDTH
        before, slope = self.filter_value, self.filter_rate + w * (self.filter_value - target)
        decay = np.exp(-w * DT)
        self.filter_value = target + decay * (before - target + slope * DT)
        self.filter_rate = decay * (self.filter_rate - w * slope * DT)
        return (before + self.filter_value) / 2

    def _implicit_step(self, drive, momentum):
        """zeta after the step: (zeta+ - zeta) / DT = f at the mean of zeta and zeta+, by fixed-point iteration."""
        v, (jx, jy, jz) = self.vehicle, self.vehicle.inertia
        after = self.zeta
        for _ in range(8):
            vz, p, q, r = ((self.zeta + after) / 2).T
            coupling = np.column_stack(
                [
                    -v.drag_coefficient / v.mass * vz,
                    (jy - jz) / jx * q * r - q * momentum / jx,
                    (jz - jx) / jy * p * r + p * momentum / jy,
                    (jx - jy) / jz * p * q,
                ]
            )
            after = self.zeta + DT * (coupling + drive)
        return after
