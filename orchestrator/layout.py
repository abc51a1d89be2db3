"""Systems: which FMUs there are, how they are connected with each other, and what feeds a diagnoser."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from rotordx.orchestrator.documents import Section, locate, read, validated


def _parameter(value: Any) -> Any:
    elements = value if isinstance(value, list) else [value]
    if not all(isinstance(e, str) or (isinstance(e, bool | int | float) and math.isfinite(e)) for e in elements):
        raise ValueError(f"{value!r} is no finite number, list of finite numbers or name of an enumeration's value")
    return value


#: A finite number, a flat list of finite numbers, or a text (name of an enumeration's value, text parameter).
ParameterValue = Annotated[Any, BeforeValidator(_parameter)]
Names = Annotated[list[str], BeforeValidator(lambda value: [value] if isinstance(value, str) else value)]


def _scale(value: Any) -> Any:
    if 0 in (value if isinstance(value, list) else [value]):
        raise ValueError("a scale of 0 loses the value")
    return value


class PortMap(Section):
    """What a port consists of: value of the port = scale * value of the FMU in SI units + offset."""

    variables: Names = Field(min_length=1, description="a variable of the FMU, or a list of them")
    unit: str | None = Field(default=None, description="the unit of the variables, if the FMU does not declare it")
    scale: Annotated[float | list[float], BeforeValidator(_scale)] = Field(
        default=1.0, description="a number other than 0, or a list with one for each element"
    )
    offset: float | list[float] = Field(default=0.0, description="a number, or a list with one for each element")


def _port_map(value: Any) -> Any:
    return {"variables": value} if isinstance(value, str | list) else value


class ComponentSettings(Section):
    """One FMU of a system."""

    fmu: str | None = Field(default=None, description="the name of a packaged FMU or the path of an .fmu file")
    fmi: Literal[2, 3] | None = Field(default=None, description="2 or 3, the FMI version of a packaged FMU")
    parameters: dict[str, ParameterValue] = Field(default={}, description="a table of the FMU's parameters")
    #: name of a port as connections know it -> what it consists of
    ports: dict[str, Annotated[PortMap, BeforeValidator(_port_map)]] = Field(
        default={}, description="a variable of the FMU, a list of them, or a table with variables, unit and scale"
    )
    #: whether it is part of the world, and so takes the vehicle as it is and not as it is believed to be
    actual_vehicle: bool | None = Field(default=None, description="true or false")
    #: whether it runs in a process of its own; if it is not stated, FMUs that are not packaged do
    isolate: bool | None = Field(default=None, description="true or false")
    timeout_s: float | None = Field(
        default=None, gt=0, le=3600, description="the longest time of one call of an isolated FMU in seconds"
    )
    memory_mib: int | None = Field(
        default=None, ge=256, le=2**20, description="the memory that an isolated FMU may take in MiB, 256 or more"
    )
    substeps: int | None = Field(
        default=None, ge=1, le=1000, description="how many steps of the FMU make one, 1 to 1000"
    )

    def extended(self, other: ComponentSettings) -> ComponentSettings:
        """These settings, extended or replaced by those that `other` has."""
        changes = {name: value for name, value in other if value is not None}
        changes |= {"parameters": self.parameters | other.parameters, "ports": self.ports | other.ports}
        return self.model_copy(update=changes)


class Connection(Section):
    """An input and the output that it is fed from."""

    source: str = Field(alias="from", description='an output, "component.port", or one element of it, "....port[1]"')
    target: str = Field(alias="to", description='an input, "component.port"')
    previous_step: bool = Field(default=False, description="true (the output at the end of the previous step) or false")


class SystemLayout(Section):
    """Components and connections of a system."""

    description: str = Field(default="", description="a text")
    components: dict[str, ComponentSettings] = Field(default={}, description="a table of components")
    connections: list[Connection] = Field(default=[], description="a list of connections")
    #: input port of every diagnoser -> the output that feeds it
    diagnoser_inputs: dict[str, str] = Field(default={}, description="a table: input port = output")


def load_layout(system: str) -> SystemLayout:
    """Layout of a packaged system or of a TOML file.

    Raises:
        UserError: there is no such system, or it is invalid; one sentence a line.
    """
    path = locate(system, "systems")
    return validated(SystemLayout, read(path), str(path))
