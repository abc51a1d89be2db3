"""How the columns of somebody else's flight log become the inputs of a diagnoser, as one TOML file.

Every table of the file is named after the diagnoser input that it feeds. Values are converted as
SI value = sign * unit * cell. Frames are NED and FRD, as everywhere.
"""

from __future__ import annotations

from math import pi
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from rotordx.orchestrator import documents
from rotordx.orchestrator.documents import Section
from rotordx.orchestrator.errors import UserError

STANDARD_GRAVITY = 9.80665  #: m/s2, what accelerometers and their data sheets mean by "g"

#: SI units per unit of a column
UNITS = {
    **{"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    **{"m": 1.0, "cm": 1e-2, "mm": 1e-3},
    **{"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3},
    **{"m/s2": 1.0, "g": STANDARD_GRAVITY, "mg": 1e-3 * STANDARD_GRAVITY},
    **{"rad": 1.0, "mrad": 1e-3, "deg": pi / 180},
    **{"rad/s": 1.0, "mrad/s": 1e-3, "deg/s": pi / 180, "rpm": pi / 30},
}

_THREE = "a list of three columns: about the front, the right and the down axis"
_SIGNS = "a list of three signs, 1 or -1"

Column = Annotated[str, Field(min_length=1, description="the name of a column")]
Sign = Annotated[Literal[1, -1], Field(description="1 or -1")]
Age = Annotated[float, Field(ge=-1, le=1, description="a time in seconds, -1 to 1: age of a value at its time stamp")]
Positive = Annotated[float, Field(gt=0)]
Row = Annotated[list[float], Field(min_length=1)]


class _Input(Section):
    @property
    def column_names(self) -> tuple[str, ...]:
        """Columns of the log that this table and those within it read, once each."""
        names: list[str] = []
        for field, value in self:
            if field == "column":
                names.append(value)
            elif field == "columns":
                names.extend(value or ())
            elif isinstance(value, _Input):
                names.extend(value.column_names)
        return tuple(dict.fromkeys(names))


class TimeStamps(_Input):
    """When each row was logged; increases from row to row."""

    column: Column
    unit: Literal["s", "ms", "us", "ns"] = Field(description="s, ms, us or ns")


class Altitude(_Input):
    """Height: sign 1 if the column grows upwards."""

    column: Column
    unit: Literal["m", "cm", "mm"] = Field(description="m, cm or mm")
    sign: Sign = 1
    delay_s: Age = 0.0


class SpecificForce(_Input):
    """What an accelerometer along the body's vertical axis shows: sign 1 if it shows +1 g at rest."""

    column: Column
    unit: Literal["m/s2", "g", "mg"] = Field(description="m/s2, g or mg")
    sign: Sign = 1
    delay_s: Age = 0.0


class Velocity(_Input):
    """Vertical velocity: sign 1 if the column is positive downwards, -1 if upwards."""

    column: Column
    unit: Literal["m/s", "cm/s", "mm/s"] = Field(description="m/s, cm/s or mm/s")
    sign: Sign = 1
    delay_s: Age = 0.0
    #: rotordx's own sensors give it filtered
    filtered: bool = Field(False, description="true if it already passed filter (33) of the fdie paper, else false")


class VerticalVelocity(_Input):
    """From a velocity, from an altitude, or from an altitude and, above a crossover frequency, an accelerometer."""

    velocity: Velocity | None = None
    altitude: Altitude | None = None
    specific_force: SpecificForce | None = None
    crossover_rad_s: float | None = Field(None, ge=0.1, le=100, description="a frequency in rad/s, 0.1 to 100")

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.velocity is None) == (self.altitude is None):
            raise ValueError("give it a table `velocity` or a table `altitude`, and not both")
        if (self.specific_force is None) != (self.crossover_rad_s is None):
            raise ValueError("`specific_force` and `crossover_rad_s` are given together or not at all")
        if self.specific_force is not None and self.altitude is None:
            raise ValueError("`specific_force` needs an `altitude` beside it, from which to take the slow part")
        return self


class BodyRate(_Input):
    """p, q, r: a gyro with the axes front, left, up has the signs 1, -1, -1."""

    columns: list[Column] = Field(min_length=3, max_length=3, description=_THREE)
    unit: Literal["rad/s", "mrad/s", "deg/s"] = Field(description="rad/s, mrad/s or deg/s")
    sign: list[Sign] = Field([1, 1, 1], min_length=3, max_length=3, description=_SIGNS)
    delay_s: Age = 0.0


class Position(_Input):
    """Where the craft was, north, east, down or along any such right-handed axes; shown, not diagnosed from."""

    columns: list[Column] = Field(min_length=3, max_length=3, description="a list of three columns: north, east, down")
    unit: Literal["m", "cm", "mm"] = Field(description="m, cm or mm")
    sign: list[Sign] = Field([1, 1, 1], min_length=3, max_length=3, description=_SIGNS)
    delay_s: Age = 0.0


class Euler(_Input):
    """Measured roll, pitch and yaw; without them (a controller's setpoints are none) what to take instead.

    `level`: zero, which costs 1.5 % of thrust at 10 degrees. `integrated_body_rate`: roll and pitch are p and q
    integrated and forgotten towards level, yaw is zero.
    """

    source: Literal["columns", "level", "integrated_body_rate"] = Field(
        description="columns, level or integrated_body_rate"
    )
    columns: list[Column] | None = Field(None, min_length=3, max_length=3, description=_THREE)
    unit: Literal["rad", "mrad", "deg"] | None = Field(None, description="rad, mrad or deg")
    sign: list[Sign] = Field([1, 1, 1], min_length=3, max_length=3, description=_SIGNS)
    delay_s: Age = 0.0
    forgetting_time_s: Positive | None = Field(None, description="a time in seconds, above 0")

    @model_validator(mode="after")
    def _fits_source(self) -> Self:
        needed = {"columns": {"columns", "unit"}, "integrated_body_rate": {"forgetting_time_s"}}.get(self.source, set())
        _check_fields(self, needed, {"columns", "unit", "forgetting_time_s"}, f'source = "{self.source}"')
        return self


class RotorSpeedCommand(_Input):
    """Command of each rotor of the vehicle file, in its order: clip(mixer @ columns).

    `thrust_proportional`: the command is proportional to thrust, and at `full_scale` the rotor turns at the vehicle
    file's `rotor_speed_max`. `rotor_speed`: the command is a speed.
    """

    kind: Literal["thrust_proportional", "rotor_speed"] = Field(description="thrust_proportional or rotor_speed")
    columns: list[Column] = Field(min_length=1, description="a list of columns")
    mixer: list[Row] | None = Field(
        None, min_length=4, max_length=4, description="4 rows, one for each rotor, with a factor for each column"
    )
    clip: list[float] | None = Field(None, min_length=2, max_length=2, description="[lowest, highest] command")
    full_scale: Positive | None = Field(None, description="the command at which a rotor turns at full speed, above 0")
    unit: Literal["rad/s", "rpm"] | None = Field(None, description="rad/s or rpm")
    delay_s: float = Field(0.0, ge=-1, le=1, description="a time in seconds, -1 to 1: from the stamp to the motors")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if self.mixer is None and len(self.columns) != 4:
            raise ValueError(f"`columns` names {len(self.columns)}; name one for each rotor, 4, or give a `mixer`")
        if any(len(row) != len(self.columns) for row in self.mixer or ()):
            raise ValueError(f"every row of `mixer` needs one factor for each of the {len(self.columns)} `columns`")
        if self.clip is not None and self.clip[0] >= self.clip[1]:
            raise ValueError("`clip` must be [lowest, highest]")
        needed = {"full_scale"} if self.kind == "thrust_proportional" else {"unit"}
        _check_fields(self, needed, {"full_scale", "unit"}, f'kind = "{self.kind}"')
        return self


class Airborne(_Input):
    """Which rows count: those where a column is above a limit, without a margin at both ends."""

    column: Column
    above: float = Field(description="a number in the column's own unit")
    margin_start_s: float = Field(0.0, ge=0, description="a time in seconds, 0 or larger")
    margin_end_s: float = Field(0.0, ge=0, description="a time in seconds, 0 or larger")


class Samples(Section):
    """Which imperfections of a log are tolerated."""

    #: bridged by interpolation; a longer gap ends the airborne part
    longest_gap_s: Positive = Field(0.05, description="a time in seconds, above 0")
    #: shorter airborne parts are left out: diagnosers take about 2 s to settle
    shortest_part_s: float = Field(3.0, ge=1, description="a time in seconds, 1 or larger")
    #: rows with an empty or non-finite cell are left out instead of having the log refused
    skip_incomplete_rows: bool = Field(False, description="true or false")


class SignalMap(_Input):
    """One signal mapping file."""

    name: str = Field("", description="a text")
    description: str = Field("", description="a text")
    time: TimeStamps
    rotor_speed_command: RotorSpeedCommand
    body_rate: BodyRate
    euler: Euler
    vertical_velocity: VerticalVelocity
    position: Position | None = None
    airborne: Airborne | None = None
    samples: Samples = Samples()

    def without_position(self) -> SignalMap:
        """What the diagnosers need of it."""
        return self.model_copy(update={"position": None})


def load_signal_map(name_or_path: str | Path) -> SignalMap:
    """Read and check a signal mapping.

    Args:
        name_or_path: name of a packaged mapping, or path of a mapping file (ends in `.toml`).

    Raises:
        UserError: there is no such mapping, or it is invalid; one sentence a line, each names file and field.
    """
    path = documents.locate(str(name_or_path), "signal_maps")
    return documents.validated(SignalMap, {"name": path.stem} | documents.read(path), str(path))


def matching_signal_map(column_names: list[str], log: str) -> SignalMap:
    """The one packaged mapping whose columns a log has, but perhaps those of the position.

    Raises:
        UserError: if none fits, or more than one.
    """
    packaged = [load_signal_map(name) for name in documents.packaged_names("signal_maps")]
    missing = {
        m.name: [name for name in m.without_position().column_names if name not in column_names] for m in packaged
    }
    fitting = [m for m in packaged if not missing[m.name]]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        found = f"the signal mappings {' and '.join(m.name for m in fitting)} fit"
    else:
        nearest = min(missing, key=lambda name: len(missing[name]))
        found = f"no packaged signal mapping fits, {nearest} for lack of the columns {', '.join(missing[nearest])}"
    raise UserError(f"{log}: {found}; say with --signals MAP.toml what the columns mean")


def _check_fields(section: Section, needed: set[str], all_: set[str], reason: str) -> None:
    """Of some optional fields, those that are needed must be given and the others must not."""
    for field in sorted(all_):
        given = getattr(section, field) is not None
        if given != (field in needed):
            raise ValueError(f"{reason} {'has no use for' if given else 'needs'} `{field}`")
