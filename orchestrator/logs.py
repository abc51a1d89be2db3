"""Recorded flights as a diagnoser sees them: read, checked, mapped, resampled to its step, airborne parts only.

Measurements are interpolated linearly, commands are held. What is derived from several columns is filtered on the
uniform grid over the whole log, so that no filter starts anew at take-off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotordx.fmus.shell.ports import STEP_SIZE
from rotordx.fmus.vehicles import Vehicle
from rotordx.gains.flights import Flight
from rotordx.orchestrator import signal_map as maps
from rotordx.orchestrator.errors import UserError

Array = NDArray[np.float64]

LARGEST_GRID = 20_000_000  #: samples; more than 11 hours at 500 Hz is a wrong unit of time
CLOCK_TOLERANCE = 1e-7  #: s by which a time stamp may be late, and its command still be in time for a step


@dataclass(frozen=True)
class LoggedFlight:
    """The airborne parts of one log, and what was left out of it."""

    path: Path
    signal_map: maps.SignalMap
    step_size: float  #: s, of the grid of all parts
    parts: list[Flight]  #: in the order of time, which counts from the log's first row
    positions: list[Array] | None  #: (N, 3) m, NED, of each part, if it was logged
    notes: list[str]  #: sentences


def read_flight(
    path: Path, signal_map: maps.SignalMap | None, vehicle: Vehicle, step_size: float = STEP_SIZE.start[0]
) -> LoggedFlight:
    """Airborne parts of a log on the grid of a diagnoser.

    Args:
        path: CSV with a header line, or Parquet (`.parquet`).
        signal_map: what its columns mean; None: the packaged mapping that fits its columns.
        vehicle: gives the speed at full command, gravity and the bandwidth of the velocity filter.
        step_size: of the diagnoser, s.

    Raises:
        UserError: the log cannot be used; the message names file, column, row and remedy.
    """
    table = _read_table(path)
    signal_map = signal_map or maps.matching_signal_map(table.column_names, str(path))
    if signal_map.position is not None and not set(signal_map.position.columns) <= set(table.column_names):
        signal_map = signal_map.without_position()
    columns, skipped = _columns(path, table, signal_map)
    stamps = _time(path, columns[signal_map.time.column] * maps.UNITS[signal_map.time.unit], step_size)
    grid = step_size * np.arange(int((stamps[-1] + CLOCK_TOLERANCE) / step_size) + 1, dtype=np.float64)
    log = _ResampledLog(columns, stamps, grid, step_size)

    parts, notes = _airborne_parts(log, signal_map)
    if skipped:
        notes.append(f"{skipped} incomplete rows were skipped")
    if not parts:
        raise UserError(
            f"{path}: no airborne part of at least {signal_map.samples.shortest_part_s:g} s is left"
            f"{f' ({notes[0]})' if notes else ''}; check [airborne] and [samples] of the signal mapping"
        )
    signals = _signals(log, signal_map, vehicle)
    flights = [
        Flight(f"{path.name} from {grid[part.start]:.2f} s", grid[part], **{k: v[part] for k, v in signals.items()})
        for part in parts
    ]
    positions = None
    if signal_map.position is not None:
        position = _axes(log, signal_map.position)
        positions = [position[part] for part in parts]
    return LoggedFlight(path, signal_map, step_size, flights, positions, notes)


def _read_table(path: Path) -> Any:
    """The log as an Arrow table with at least one row."""
    import pyarrow as pa
    from pyarrow import csv, parquet

    try:
        if path.suffix == ".parquet":
            table = parquet.read_table(path)
        else:
            table = csv.read_csv(path, read_options=csv.ReadOptions(use_threads=False))  # one thread names the row
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror or error}; give the path of a flight log") from error
    except pa.ArrowInvalid as error:
        what = "".join(c if c.isprintable() else " " for c in str(error))
        raise UserError(
            f"{path}: is no complete {'Parquet' if path.suffix == '.parquet' else 'CSV'} log: {what}; "
            "give a CSV file with a header line or a Parquet file, and delete a row that was cut off"
        ) from error
    if table.num_rows == 0:
        raise UserError(f"{path}: has no rows; give a log with at least one flight in it")
    return table


def _columns(path: Path, table: Any, signal_map: maps.SignalMap) -> tuple[dict[str, Array], int]:
    """The columns that the mapping reads, finite, and the number of incomplete rows that were left out."""
    import pyarrow as pa
    from pyarrow import compute

    columns = {}
    for name in signal_map.column_names:
        if table.column_names.count(name) != 1:
            raise UserError(
                f"{path}: has {'two columns' if name in table.column_names else 'no column'} `{name}`, which the "
                f"signal mapping `{signal_map.name}` reads; it has {', '.join(table.column_names)}; "
                "correct the mapping or give another one with --signals"
            )
        column = table.column(name)
        try:
            columns[name] = compute.cast(column, pa.float64()).to_numpy().astype(np.float64)
        except pa.ArrowInvalid as error:
            row, cell = _first_text(column)
            raise UserError(
                f"{path}: column `{name}`, row {row}: '{cell}' is no number; correct it or leave the cell empty"
            ) from error
    complete = np.isfinite(np.stack(list(columns.values()))).all(axis=0)
    if not complete.all() and not signal_map.samples.skip_incomplete_rows:
        row = int(np.argmin(complete))
        name = next(name for name, values in columns.items() if not np.isfinite(values[row]))
        raise UserError(
            f"{path}: column `{name}`, row {row + 1}: empty or not finite; delete the row, or set "
            f"`skip_incomplete_rows = true` in [samples] of the signal mapping ({np.sum(~complete)} such rows)"
        )
    return {name: values[complete] for name, values in columns.items()}, int(np.sum(~complete))


def _first_text(column: Any) -> tuple[int, str]:
    """(row counted from 1, content) of the first cell that is no number."""
    for row, cell in enumerate(column.to_pylist(), start=1):
        try:
            float(cell if cell is not None else "nan")
        except (TypeError, ValueError):
            return row, str(cell)
    return 1, str(column.type)


def _time(path: Path, stamps: Array, step_size: float) -> Array:
    """Time from the first row (s), checked."""
    if len(stamps) < 2:
        raise UserError(f"{path}: has {len(stamps)} complete row(s); a flight needs many")
    late = np.flatnonzero(np.diff(stamps) <= 0)
    if late.size:
        before, after = stamps[late[0]], stamps[late[0] + 1]
        raise UserError(
            f"{path}: time does not increase from row {late[0] + 1} ({before:.9g} s) to row {late[0] + 2} "
            f"({after:.9g} s); sort the rows by time and delete duplicates"
        )
    if (stamps[-1] - stamps[0]) / step_size > LARGEST_GRID:
        raise UserError(
            f"{path}: lasts {stamps[-1] - stamps[0]:.3g} s, more than a flight can; correct the unit of [time] "
            "in the signal mapping"
        )
    return stamps - stamps[0]


@dataclass(frozen=True)
class _ResampledLog:
    """Columns of a log by name, and how they are brought onto the grid."""

    columns: dict[str, Array]
    stamps: Array  #: s, one for each row
    grid: Array  #: s, uniform
    step_size: float

    def measured(self, name: str, delay: float, full_turn: float | None = None) -> Array:
        """Column on the grid, interpolated linearly; its values are `delay` older than their stamps.

        An angle is made continuous first: from row to row it takes the shorter way round the `full_turn`.
        """
        values = self.columns[name]
        if full_turn is not None:
            values = np.unwrap(values, period=full_turn)
        return np.interp(self.grid + delay, self.stamps, values)

    def commanded(self, name: str, delay: float) -> Array:
        """Column as it acts over the step that ends at each grid point, from `delay` after its stamp to the next."""
        start_of_step = self.grid - self.step_size - delay + CLOCK_TOLERANCE
        rows = np.searchsorted(self.stamps, start_of_step, side="right") - 1
        return self.columns[name][np.clip(rows, 0, len(self.stamps) - 1)]

    def filtered(self, numerator: Sequence[float], denominator: Sequence[float], signal: Array) -> Array:
        """Output of a continuous transfer function; exact for a signal that is linear between grid points.

        It starts in the steady state of the first value.
        """
        from scipy.signal import cont2discrete, lfilter, lfilter_zi

        b, a, _ = cont2discrete((numerator, denominator), self.step_size, method="foh")
        return lfilter(b[0], a, signal, zi=lfilter_zi(b[0], a) * signal[0])[0]


def _airborne_parts(log: _ResampledLog, signal_map: maps.SignalMap) -> tuple[list[slice], list[str]]:
    """Runs of grid points that are airborne and covered by rows, without margins, and notes on what was left out."""
    flying = np.ones(len(log.grid), dtype=bool)
    start, end = 0.0, 0.0
    if signal_map.airborne is not None:
        flying = log.measured(signal_map.airborne.column, 0.0) > signal_map.airborne.above
        start, end = signal_map.airborne.margin_start_s, signal_map.airborne.margin_end_s
    notes = []
    for row in np.flatnonzero(np.diff(log.stamps) > signal_map.samples.longest_gap_s):
        before, after = log.stamps[row : row + 2]
        flying &= (log.grid <= before) | (log.grid >= after)
        notes.append(f"{after - before:.3g} s without rows at {before:.2f} s")

    edges = np.flatnonzero(np.diff(flying, prepend=False, append=False))
    shortest = signal_map.samples.shortest_part_s
    parts, too_short = [], 0
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        part = slice(int(first + round(start / log.step_size)), int(last - round(end / log.step_size)))
        if (part.stop - part.start - 1) * log.step_size >= shortest:
            parts.append(part)
        else:
            too_short += 1
    if too_short:
        notes.append(f"{too_short} airborne part(s) shorter than {shortest:g} s were left out")
    return parts, notes


def _signals(log: _ResampledLog, signal_map: maps.SignalMap, vehicle: Vehicle) -> dict[str, Array]:
    """Diagnoser inputs on the whole grid."""
    from rotordx.fmus.vehicles.parameters import SensorParameters, VehicleParameters

    values, sensors = vehicle.fill(VehicleParameters), vehicle.fill(SensorParameters)
    body_rate = _axes(log, signal_map.body_rate)
    euler = _euler(log, signal_map.euler, body_rate)
    return {
        "rotor_speed_command": _rotor_speed_command(log, signal_map.rotor_speed_command, values.rotor_speed_max),
        "euler": euler,
        "body_rate": body_rate,
        "vertical_velocity": _vertical_velocity(
            log, signal_map.vertical_velocity, euler, values.gravity, sensors.velocity_filter_bandwidth
        ),
    }


def _axes(log: _ResampledLog, mapped: maps.BodyRate | maps.Euler | maps.Position) -> Array:
    """(N, 3) SI values of three columns."""
    unit = maps.UNITS[mapped.unit or ""]
    full_turn = 2 * np.pi / unit if isinstance(mapped, maps.Euler) else None
    columns = [log.measured(name, mapped.delay_s, full_turn) for name in mapped.columns or ()]
    return np.stack(columns, axis=1) * mapped.sign * unit


def _rotor_speed_command(log: _ResampledLog, mapped: maps.RotorSpeedCommand, rotor_speed_max: float) -> Array:
    """(N, 4) rad/s."""
    command = np.stack([log.commanded(name, mapped.delay_s) for name in mapped.columns], axis=1)
    if mapped.mixer is not None:
        command = command @ np.array(mapped.mixer).T
    if mapped.clip is not None:
        lowest, highest = mapped.clip
        command = np.clip(command, lowest, highest)
    if mapped.unit is not None:
        return command * maps.UNITS[mapped.unit]
    return rotor_speed_max * np.sqrt(np.maximum(command, 0.0) / mapped.full_scale)


def _euler(log: _ResampledLog, mapped: maps.Euler, body_rate: Array) -> Array:
    """(N, 3) rad."""
    if mapped.source == "columns":
        return _axes(log, mapped)
    euler = np.zeros_like(body_rate)
    if mapped.forgetting_time_s is not None:
        time = mapped.forgetting_time_s
        for axis in (0, 1):  # small angles: the rates of roll and pitch are p and q
            euler[:, axis] = log.filtered([time], [time, 1], body_rate[:, axis])
    return euler


def _vertical_velocity(
    log: _ResampledLog, mapped: maps.VerticalVelocity, euler: Array, gravity: float, bandwidth: float
) -> Array:
    """(N,) m/s down, passed through F = w0^2 / (s + w0)^2, (33) of the fdie paper."""

    def column(table: maps.Velocity | maps.Altitude | maps.SpecificForce) -> Array:
        return table.sign * maps.UNITS[table.unit] * log.measured(table.column, table.delay_s)

    poles = [1, 2 * bandwidth, bandwidth**2]
    if mapped.velocity is not None:
        velocity = column(mapped.velocity)
        return velocity if mapped.velocity.filtered else log.filtered([bandwidth**2], poles, velocity)
    assert mapped.altitude is not None
    down = -column(mapped.altitude)
    if mapped.specific_force is None or mapped.crossover_rad_s is None:
        return log.filtered([bandwidth**2, 0], poles, down)
    # Observer of height and velocity, driven by acceleration and corrected by height, both its poles at the
    # crossover w: V = (w^2 s Z + (s + 2 w) A) / (s + w)^2. A biased accelerometer shifts V by a constant.
    acceleration = gravity - column(mapped.specific_force) * np.cos(euler[:, 0]) * np.cos(euler[:, 1])
    crossover = mapped.crossover_rad_s
    slow = [1, 2 * crossover, crossover**2]
    velocity = log.filtered([crossover**2, 0], slow, down) + log.filtered([1, 2 * crossover], slow, acceleration)
    return log.filtered([bandwidth**2], poles, velocity)
