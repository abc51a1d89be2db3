"""Scenarios: what is flown on which vehicle, with which faults and diagnosers."""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from rotordx.fmus import diagnoser_ids
from rotordx.fmus.esc.ports import FAULT_SLOTS
from rotordx.fmus.esc.ports import Parameters as FaultParameters
from rotordx.fmus.shell.ports import table
from rotordx.orchestrator.documents import Section, locate, one_of, override, packaged_names, read, validated
from rotordx.orchestrator.layout import ComponentSettings, Connection, ParameterValue

LARGEST_LOSS = {p.name: p for p in table(FaultParameters)}["fault_magnitude"].maximum
LARGEST_SEED = 2**53  #: whole numbers up to here are exact as float64, the type of the ports

#: Standard deviations of the benchmark's gusts: accelerations x, y, z (NED) in m/s2 and p, q, r in rad/s2.
BENCHMARK_GUST_STD = [0.12, 0.12, 0.06, 0.25, 0.25, 0.03]

SixNumbers = Annotated[list[Annotated[float, Field(ge=0)]], Field(min_length=6, max_length=6)]

#: profiles in the order of their numbers in the esc -> the fields that only it has, and whether it needs them
_FIELDS_OF_PROFILE: dict[str, dict[str, bool]] = {
    "abrupt": {},
    "incipient": {"growth_rate_per_s": True},
    "function": {"slope_per_s": False, "sine_amplitude": False, "sine_rate_rad_per_s": False, "sine_phase_rad": False},
    "intermittent": {"on_time_s": True, "off_time_s": True},
}
PROFILES = list(_FIELDS_OF_PROFILE)


class Fault(Section):
    """Loss of effectiveness of one rotor from its onset on, in one of the profiles of the esc FMU."""

    rotor: int = Field(ge=1, le=4, description="a rotor, 1 to 4")
    onset_s: float = Field(ge=0, description="a time in seconds, 0 or later")
    loss_of_effectiveness: float = Field(
        ge=0, le=LARGEST_LOSS, description=f"the lost fraction of the rotor's thrust, 0 to {LARGEST_LOSS}"
    )
    profile: Literal["abrupt", "incipient", "function", "intermittent"] = Field(
        default="abrupt", description="abrupt, incipient, function or intermittent"
    )
    end_s: float | None = Field(default=None, gt=0, description="a time in seconds, later than onset_s")
    growth_rate_per_s: float | None = Field(default=None, gt=0, description="a positive rate of growth in 1/s")
    slope_per_s: float | None = Field(default=None, description="the slope of a ramp of the loss in 1/s")
    sine_amplitude: float | None = Field(default=None, description="the amplitude of a sine in the loss")
    sine_rate_rad_per_s: float | None = Field(default=None, description="the rate of that sine in rad/s")
    sine_phase_rad: float | None = Field(default=None, description="the phase of that sine at the onset in rad")
    on_time_s: float | None = Field(default=None, gt=0, description="a positive duration of a loss in seconds")
    off_time_s: float | None = Field(
        default=None, gt=0, description="the pause between two losses in seconds, positive"
    )

    @model_validator(mode="after")
    def _fits_its_profile(self) -> Self:
        for profile, fields in _FIELDS_OF_PROFILE.items():
            for name, needed in fields.items():
                given = getattr(self, name) is not None
                if given and profile != self.profile:
                    raise ValueError(f"{name} belongs to the profile {profile}, here the profile is {self.profile}")
                if needed and not given and profile == self.profile:
                    raise ValueError(f"the profile {profile} needs {name}")
        if self.end_s is not None and self.end_s <= self.onset_s:
            raise ValueError(f"end_s, {self.end_s:g}, must be later than onset_s, {self.onset_s:g}")
        return self


class Gusts(Section):
    """Ornstein-Uhlenbeck accelerations x, y, z (NED, m/s2) and p, q, r (rad/s2); what is not given is the plant's."""

    std: SixNumbers = Field(default=BENCHMARK_GUST_STD, description="6 standard deviations, each 0 or larger")
    time_constant_s: SixNumbers | None = Field(default=None, description="6 correlation times in seconds")
    limit: SixNumbers | None = Field(default=None, description="6 limits, each 0 or larger")


def _gusts(value: Any) -> Any:
    return (Gusts() if value else None) if isinstance(value, bool) else value


class Scenario(Section):
    """One flight."""

    name: str = Field(default="scenario", pattern=r"^\w[\w.-]*$", description="letters, digits, '_', '-' and '.'")
    description: str = Field(default="", description="a text")
    system: str = Field(default="quadrotor", description="the name of a packaged system or the path of a .toml file")
    vehicle: str = Field(default="lab_x", description="the name of a packaged vehicle or the path of a .toml file")
    duration_s: float = Field(gt=0, le=36000, description="a time in seconds, above 0 and at most 36000")
    step_size_s: float = Field(default=0.002, ge=1e-6, le=1, description="a time in seconds, 1e-6 to 1")
    seed: int = Field(default=1, ge=0, le=LARGEST_SEED, description="a whole number, 0 to 2^53")
    diagnosers: list[str] = Field(default=[], description="a list of names of diagnosers")
    faults: list[Fault] = Field(
        default=[], max_length=FAULT_SLOTS, description=f"a list of at most {FAULT_SLOTS} tables"
    )
    gusts: Annotated[Gusts | None, BeforeValidator(_gusts)] = Field(default=None, description="true, false or a table")
    sensor_noise: bool = Field(default=True, description="true or false")
    battery_sag_rate_per_s: float | None = Field(
        default=None, ge=0, le=1, description="the relative loss of thrust of all rotors in 1/s, 0 to 1"
    )
    #: given to every component that has a parameter of that name
    parameters: dict[str, ParameterValue] = Field(default={}, description="a table of parameters")
    #: these extend or replace the components and connections of the system
    components: dict[str, ComponentSettings] = Field(default={}, description="a table of components")
    connections: list[Connection] = Field(default=[], description="a list of connections")

    @property
    def steps(self) -> int:
        """Number of steps of the flight."""
        return round(self.duration_s / self.step_size_s)

    def plain(self) -> dict[str, Any]:
        """The scenario as plain data, which can be stored and validated again."""
        return self.model_dump(by_alias=True, exclude_none=True)

    def changed(self, **changes: Any) -> Scenario:
        """Validated copy in which some fields have other values, given as plain data.

        Raises:
            UserError: the changes are impossible.
        """
        return validated(Scenario, self.plain() | changes, self.name)

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        if abs(self.steps * self.step_size_s - self.duration_s) > 1e-9 * self.duration_s:
            raise ValueError(
                f"duration_s, {self.duration_s:g}, must be a multiple of step_size_s, {self.step_size_s:g}"
            )
        known = [*diagnoser_ids(), *(name for name, settings in self.components.items() if settings.fmu)]
        for i, name in enumerate(self.diagnosers):
            if name not in known:
                raise ValueError(f"diagnosers[{i}] is {name!r} but must be {one_of(known, name)}")
            if name in self.diagnosers[:i]:
                raise ValueError(f"diagnosers[{i}] names {name} a second time")
        for i, fault in enumerate(self.faults):
            for j, other in enumerate(self.faults[:i]):
                if (fault.rotor, fault.onset_s) == (other.rotor, other.onset_s):
                    raise ValueError(
                        f"faults[{i}].rotor: rotor {fault.rotor} already fails at {fault.onset_s:g} s in faults[{j}], "
                        "combine the two or give them different onsets"
                    )
        return self


def scenario_names() -> list[str]:
    """Names of the packaged scenarios."""
    return packaged_names("scenarios")


def load_scenario(name_or_path: str | Path, overrides: Iterable[str] = (), **changes: Any) -> Scenario:
    """Read a scenario and change it.

    Args:
        name_or_path: name of a packaged scenario, or path of a TOML file or an SSP archive.
        overrides: as given to --set, for example "faults[0].rotor=3".
        changes: new values of whole fields as plain data, for example seed=3; applied before the overrides. None
            leaves a field as it is.

    Raises:
        UserError: there is no such scenario, or it is not valid, as it is or changed; one sentence a line.
    """
    if str(name_or_path).endswith(".ssp"):
        from rotordx.orchestrator.system_structure import scenario_document  # which needs what a scenario is

        path = Path(name_or_path)
        content = scenario_document(path)
    else:
        path = locate(str(name_or_path), "scenarios")
        content = read(path)
    name = re.sub(r"[^\w.-]", "_", path.stem).lstrip(".-")
    document = {"name": name} | content | {field: value for field, value in changes.items() if value is not None}
    for assignment in overrides:
        override(document, assignment)
    return validated(Scenario, document, str(name_or_path))
