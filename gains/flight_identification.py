"""What healthy flights in closed loop tell about a vehicle: each rotor's effectiveness, and the noise of the sensors.

In hover the four mean balances of thrust and torques have the four rotors' effectiveness as their only unknowns, so a
per-rotor trim is well determined. Torque gains, inertia, motor lag, delays and drag are not: the controller answers
every disturbance, its commands are correlated with what they are meant to explain, and least squares finds gains many
times too small. Those parameters stay those of the base vehicle.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.vehicles import Vehicle
from rotordx.fmus.vehicles.parameters import SensorParameters, VehicleParameters
from rotordx.gains.flights import Flight

Array = NDArray[np.float64]

#: Hz: above the motion of a small multirotor, below the Nyquist frequency of a 100 Hz log
NOISE_BAND = (15.0, 40.0)
#: of the strongest rotor's lift: no rotor of a vehicle in the air lifts less
LEAST_LIFT = 1e-3
#: digits of what is identified, in memory as in the vehicle file
SIGNIFICANT_DIGITS = 5


@dataclasses.dataclass(frozen=True)
class Trim:
    """Effectiveness of each rotor: its thrust and torque over those that a vehicle file gives it."""

    effectiveness: Array  #: (4,) over all flights together
    of_each_flight: Array  #: (flights, 4)

    @property
    def repeatability(self) -> Array:
        """(4,) standard deviation from flight to flight, NaN of a single one."""
        if len(self.of_each_flight) < 2:
            return np.full(4, np.nan)
        return self.of_each_flight.std(axis=0, ddof=1)


def identify_vehicle(flights: Sequence[Flight], base: Vehicle, name: str) -> tuple[Vehicle, Trim]:
    """The specimen that flew: the base with trimmed rotors and the noise that was measured.

    Raises:
        ValueError: a flight is too short, or a rotor comes out without thrust.
    """
    trim = identify_trim(flights, base)
    if not (trim.effectiveness > 0).all():
        raise ValueError(
            f"rotor {int(np.argmin(trim.effectiveness)) + 1} comes out with an effectiveness of "
            f"{trim.effectiveness.min():.3g}: check signs and order of commands and body rates in the signal mapping"
        )
    values = base.fill(VehicleParameters)
    identified = {
        "thrust_coefficient": values.thrust_coefficient * trim.effectiveness,
        "torque_coefficient": values.torque_coefficient * trim.effectiveness,
        "gyro_noise_std": gyro_noise_std(flights),
        "motion_capture_position_noise_std": position_noise_std(flights, base),
    }
    rounded = {key: _rounded(value) for key, value in identified.items()}
    description = f"{base.description}, a specimen identified from its flights"
    return dataclasses.replace(base, name=name, description=description, parameters=base.parameters | rounded), trim


def identify_trim(flights: Sequence[Flight], vehicle: Vehicle) -> Trim:
    """Effectiveness of each rotor for which the mean of d zeta/dt - f vanishes in all four channels.

    f, (24) of the fdie paper, is linear in the effectiveness e_s: d zeta/dt - f = -sum_s (e_s - 1) h_s. Motor lag and
    velocity filter are passed as in the diagnosers; the flights weigh by their durations.

    Args:
        flights: each lasts several seconds, or the accelerations at its ends do not average out.
        vehicle: to which the effectiveness is relative.

    Raises:
        ValueError: a flight is too short.
    """
    unexplained, signatures, duration = zip(*(_mean_balance(flight, vehicle) for flight in flights), strict=True)
    each = [1 - np.linalg.solve(h, r) for h, r in zip(signatures, unexplained, strict=True)]
    together = np.linalg.solve(
        np.average(signatures, axis=0, weights=duration), np.average(unexplained, axis=0, weights=duration)
    )
    return Trim(1 - together, np.array(each))


def gyro_noise_std(flights: Sequence[Flight]) -> float:
    """Standard deviation (rad/s) of white noise that has, at the flights' step, the gyro's spectral density.

    Measured between 15 and 40 Hz, where a craft hardly moves; the largest of the three axes. A log that was sampled
    less often than the step has its noise at lower frequencies: a diagnoser's filters feel its density, not its
    deviation from sample to sample.
    """
    frequency, density = _spectrum(flights, lambda flight: flight.body_rate)
    band = (frequency >= NOISE_BAND[0]) & (frequency <= NOISE_BAND[1])
    return float(np.sqrt(np.median(density[band], axis=0).max() / 2 / flights[0].step_size))


def position_noise_std(flights: Sequence[Flight], vehicle: Vehicle) -> float:
    """Noise (m) of a motion capture with the vehicle's period behind which the vertical velocity would be as noisy.

    Noise of deviation sigma held for a period T has the one-sided density 2 T sigma^2 sinc^2(f T), and filter (33)
    makes of it |s w0^2 / (s + w0)^2|^2 times that. Measured as `gyro_noise_std`.
    """
    sensors = vehicle.fill(SensorParameters)
    period, bandwidth = sensors.motion_capture_period, sensors.velocity_filter_bandwidth
    frequency, density = _spectrum(flights, lambda flight: flight.vertical_velocity)
    band = (frequency >= NOISE_BAND[0]) & (frequency <= min(NOISE_BAND[1], 0.5 / period))
    s = 2j * np.pi * frequency[band]
    of_unit_noise = 2 * period * np.sinc(frequency[band] * period) ** 2
    of_unit_noise *= np.abs(s * bandwidth**2 / (s + bandwidth) ** 2) ** 2
    return float(np.sqrt(np.median(density[band] / of_unit_noise)))


def vehicle_file(vehicle: Vehicle, base: str, trim: Trim, flights: Sequence[Flight]) -> str:
    """Text of the vehicle file of an identified vehicle: what differs from its base, with unit and source per line.

    Args:
        vehicle: from `identify_vehicle`.
        base: name of the base, or its path relative to the file.
        trim: from `identify_vehicle`.
        flights: that they were identified from.
    """
    total = sum(flight.time[-1] - flight.time[0] for flight in flights)
    sources = "\n".join(f"#   {f.name}, {f.time[-1] - f.time[0]:.2f} s" for f in flights)
    spread = ", ".join("?" if np.isnan(s) else f"{100 * s:.1f}" for s in trim.repeatability)
    trims = ", ".join(f"{e:.4f}" for e in trim.effectiveness)
    lines = [
        "# Identified by `rotordx identify` from healthy flights in closed loop:",
        sources,
        "# Inertia, geometry, motor lag, drag and delays cannot be identified so, they are those of the base.",
        "",
        f'description = "{vehicle.description}"',
        f'base = "{base}"',
        "",
        f"# Effectiveness over the base: {trims}; from flight to flight it varies by {spread} % (1 sigma).",
        "[rotors]",
        *(
            f"{key} = {_toml(vehicle.parameters[key])} # {unit}, mean balance of thrust and torques over {total:.1f} s"
            for key, unit in (("thrust_coefficient", "N.s2"), ("torque_coefficient", "N.m.s2"))
        ),
        "",
        "[sensors]",
        f"gyro_noise_std = {_toml(vehicle.parameters['gyro_noise_std'])} "
        "# rad/s, spectral density of the body rates at 15 to 40 Hz",
        f"motion_capture_position_noise_std = {_toml(vehicle.parameters['motion_capture_position_noise_std'])} "
        "# m, captured positions as noisy as the vertical velocity at 15 to 40 Hz",
    ]
    return "\n".join(lines) + "\n"


def _mean_balance(flight: Flight, vehicle: Vehicle) -> tuple[Array, Array, float]:
    """Means over a flight of d zeta/dt - f (4,) and of [h_1 .. h_4] (4, 4), and the duration (s) of it they cover."""
    from scipy.signal import cont2discrete, lfilter, lfilter_zi

    values, step = vehicle.fill(VehicleParameters), flight.step_size
    bandwidth = vehicle.fill(SensorParameters).velocity_filter_bandwidth

    decay = np.exp(-step / values.motor_time_constant)
    command = flight.rotor_speed_command
    speed = lfilter([1 - decay], [1, -decay], command, axis=0, zi=decay * command[:1])[0]
    zeta = np.column_stack((flight.vertical_velocity, flight.body_rate))
    flat = np.concatenate([np.atleast_1d(value) for value in vars(values).values()])
    nominal, signatures = (np.array(v) for v in _rate_model()(zeta.T, flight.euler.T, speed.T, flat))
    signatures = signatures.reshape(4, len(flight.time), 4)  # channel, sample, rotor

    numerator, poles = [bandwidth**2], [1, 2 * bandwidth, bandwidth**2]
    b, a, _ = cont2discrete((numerator, poles), step, method="zoh")
    vertical = np.column_stack((nominal[0], signatures[0]))
    filtered = lfilter(b[0], a, vertical, axis=0, zi=np.outer(lfilter_zi(b[0], a), vertical[0]))[0]
    nominal[0], signatures[0] = filtered[:, 0], filtered[:, 1:]

    start = round(6 / bandwidth / step)  # the filter has forgotten that it did not know what came before
    if len(flight.time) < 2 * start:
        raise ValueError(f"{flight.name} lasts only {flight.time[-1] - flight.time[0]:.2f} s; fly longer")
    duration = flight.time[-1] - flight.time[start]
    rate = (zeta[-1] - zeta[start]) / duration
    mean_signatures = signatures[:, start:].mean(axis=1)
    lift = mean_signatures[0]  # each rotor's share
    if lift.min() < LEAST_LIFT * lift.max():
        raise ValueError(
            f"{flight.name}: rotor {int(lift.argmin()) + 1} was commanded to lift next to nothing; "
            "check the commands in the signal mapping"
        )
    return rate - nominal[:, start:].mean(axis=1), mean_signatures, float(duration)


@cache
def _rate_model() -> Any:
    """CasADi function (zeta, euler, rotor_speed, vehicle) -> (f, [h_1 .. h_4]); its arguments may have many columns."""
    from casadi import SX, Function

    from rotordx.fmus.model_terms.symbols import symbols
    from rotordx.fmus.model_terms.terms import fault_signatures, rate_dynamics

    zeta, euler, speed = SX.sym("zeta", 4), SX.sym("euler", 3), SX.sym("rotor_speed", 4)
    flat, vehicle = symbols(VehicleParameters, "vehicle")
    model = [rate_dynamics(zeta, euler, speed, vehicle), fault_signatures(euler, speed, vehicle)]
    return Function("rate_model", [zeta, euler, speed, flat], model)


def _spectrum(flights: Sequence[Flight], signal: Callable[[Flight], Array]) -> tuple[Array, Array]:
    """Frequencies (Hz) and one-sided power spectral density of a signal, averaged over the flights."""
    from scipy.signal import welch

    length = min(512, *(len(flight.time) for flight in flights))
    spectra = [welch(signal(flight), fs=1 / flight.step_size, nperseg=length, axis=0) for flight in flights]
    return spectra[0][0], np.mean([density for _, density in spectra], axis=0)


def _rounded(value: Array | float) -> float | tuple[float, ...]:
    if np.ndim(value):
        return tuple(float(f"{v:.{SIGNIFICANT_DIGITS}g}") for v in np.asarray(value))
    return float(f"{value:.{SIGNIFICANT_DIGITS}g}")


def _toml(value: float | tuple[float, ...]) -> str:
    return repr(list(value)) if isinstance(value, tuple) else repr(value)
