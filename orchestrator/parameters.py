"""Parameters of every component: the scenario's, else the design's, else the vehicle's, else the FMU's own."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rotordx.fmus import diagnoser_ids
from rotordx.fmus.esc.ports import Parameters as EscParameters
from rotordx.fmus.shell.ports import table
from rotordx.fmus.vehicles import Vehicle, VehicleError, load_design
from rotordx.orchestrator.component import Component
from rotordx.orchestrator.documents import one_of
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.layout import ComponentSettings
from rotordx.orchestrator.scenario import PROFILES, Scenario
from rotordx.orchestrator.variables import Variable

#: field of a fault -> parameter of the esc with a slot for each fault
FAULT_PARAMETERS = {
    "rotor": "fault_rotor",
    "profile": "fault_profile",
    "onset_s": "fault_onset",
    "end_s": "fault_end",
    "loss_of_effectiveness": "fault_magnitude",
    "growth_rate_per_s": "fault_growth_rate",
    "slope_per_s": "fault_slope",
    "sine_amplitude": "fault_sine_amplitude",
    "sine_rate_rad_per_s": "fault_sine_rate",
    "sine_phase_rad": "fault_sine_phase",
    "on_time_s": "fault_on_time",
    "off_time_s": "fault_off_time",
}
BENCHMARK = "lab_x"  #: the vehicle whose design is in the start values of the diagnosers' FMUs
FAULT_SLOT_STARTS = {port.name: port.start for port in table(EscParameters)}  # what unused slots and fields hold
_NOISE = ("gyro_noise_std", "motion_capture_position_noise_std", "motion_capture_attitude_noise_std")


def parameter_values(
    scenario: Scenario,
    settings: Mapping[str, ComponentSettings],
    components: Mapping[str, Component],
    vehicle: Vehicle,
    actual_vehicle: Vehicle,
) -> dict[str, dict[str, Sequence[Any]]]:
    """Elements of the parameters to set, by component and name; what is not among them keeps its start value.

    Args:
        scenario: its `components` and `parameters` count most, then its faults, gusts, seed and the like.
        settings: of the components, the scenario's merged with the system's.
        components: the FMU instances.
        vehicle: as controller and diagnosers believe it to be; its designs are the diagnosers' gains.
        actual_vehicle: as it is, for the components that are part of the world.

    Raises:
        UserError: a name is unknown, or a value does not fit its parameter.
    """
    common = {name: (value, origin) for name, value, origin in _facts(scenario)}
    common |= {name: (value, f"parameters.{name}") for name, value in scenario.parameters.items()}
    optional = {"seed", "step_size", *_NOISE}
    for name, (_, origin) in common.items():
        if name not in optional and not any(name in component.parameters for component in components.values()):
            known = {parameter for component in components.values() for parameter in component.parameters}
            raise UserError(f"{origin}: no component has a parameter {name}, it must be {one_of(sorted(known), name)}")
    values = {}
    for name, component in components.items():
        chosen = _from_vehicle(actual_vehicle if settings[name].actual_vehicle else vehicle)
        chosen |= _from_design(vehicle, settings[name].fmu)
        chosen |= common
        chosen = {parameter: chosen[parameter] for parameter in component.parameters if parameter in chosen}
        for parameter, value in settings[name].parameters.items():
            origin = f"components.{name}.parameters.{parameter}"
            if parameter not in component.parameters:
                raise UserError(
                    f"{origin}: there is no such parameter, it must be {one_of(component.parameters, parameter)}"
                )
            chosen[parameter] = (value, origin)
        values[name] = {p: _elements(component.parameters[p], value, origin) for p, (value, origin) in chosen.items()}
    return values


def missing_design(vehicle: Vehicle, fmu: str | None) -> str | None:
    """A sentence if a diagnoser that needs a design has none for a vehicle, and so flies with the benchmark's gains."""
    if fmu not in diagnoser_ids() or load_design(vehicle, fmu) or not load_design(BENCHMARK, fmu):
        return None
    return f"there is no design for {vehicle.name}, this flight uses the gains for {BENCHMARK}"


def _facts(scenario: Scenario) -> Iterator[tuple[str, Any, str]]:
    """Parameter, value and field of what a scenario says about the flight as a whole."""
    given = {*scenario.parameters, *(name for s in scenario.components.values() for name in s.parameters)}
    for parameter in given & set(FAULT_PARAMETERS.values()):
        raise UserError(
            f"{parameter} cannot be set as a parameter: declare the fault in `faults`, so that it is scored"
        )
    yield "seed", scenario.seed, "seed"
    yield "step_size", scenario.step_size_s, "step_size_s"
    if scenario.faults:
        for field, parameter in FAULT_PARAMETERS.items():
            values = [getattr(fault, field) for fault in scenario.faults]
            numbers = [PROFILES.index(value) if field == "profile" else value for value in values]
            unused = FAULT_SLOT_STARTS[parameter][len(numbers) :]
            used = [start if n is None else n for n, start in zip(numbers, FAULT_SLOT_STARTS[parameter], strict=False)]
            yield parameter, [*used, *unused], "faults"
    if scenario.gusts is not None:
        for field, parameter in (
            ("std", "gust_std"),
            ("time_constant_s", "gust_time_constant"),
            ("limit", "gust_limit"),
        ):
            if getattr(scenario.gusts, field) is not None:
                yield parameter, getattr(scenario.gusts, field), f"gusts.{field}"
    if scenario.battery_sag_rate_per_s is not None:
        yield "battery_sag_rate", scenario.battery_sag_rate_per_s, "battery_sag_rate_per_s"
    if not scenario.sensor_noise:
        for parameter in _NOISE:
            yield parameter, 0.0, "sensor_noise"


def _from_vehicle(vehicle: Vehicle) -> dict[str, tuple[Any, str]]:
    return {name: (value, f"vehicle {vehicle.name}, {name}") for name, value in vehicle.parameters.items()}


def _from_design(vehicle: Vehicle, fmu: str | None) -> dict[str, tuple[Any, str]]:
    try:
        design = load_design(vehicle, fmu) if fmu in diagnoser_ids() else None
    except VehicleError as error:
        raise UserError(str(error)) from error
    parameters = design["parameters"] if design else {}
    return {name: (value, f"design of {fmu} for {vehicle.name}, {name}") for name, value in parameters.items()}


def _elements(variable: Variable, value: Any, origin: str) -> Sequence[Any]:
    """Elements of a parameter, checked; the names of an enumeration's values become numbers."""
    if isinstance(value, list | tuple) != (variable.shape is not None) or (
        variable.shape is not None and len(value) != variable.shape
    ):
        wanted = "one value" if variable.shape is None else f"a list of {variable.shape} numbers"
        raise UserError(f"{origin} is {value!r} but must be {wanted} ({variable.unit}: {variable.description})")
    elements = list(value) if isinstance(value, list | tuple) else [value]
    for i, element in enumerate(elements):
        where = origin if variable.shape is None else f"{origin}[{i}]"
        if variable.choices:
            if element not in variable.choices and element not in variable.choices.values():
                raise UserError(f"{where} is {element!r} but must be {one_of(variable.choices, str(element))}")
            elements[i] = variable.choices.get(element, element)
        elif variable.type == "String":
            elements[i] = str(element)
        elif isinstance(element, str) or (isinstance(element, bool) != (variable.type == "Boolean")):
            raise UserError(f"{where} is {element!r} but must be a number ({variable.unit}: {variable.description})")
        elif variable.access and not variable.access.is_real and element != int(element):
            raise UserError(f"{where} is {element:g} but must be a whole number ({variable.description})")
        elif not variable.minimum <= element <= variable.maximum:
            raise UserError(
                f"{where} is {element:g} but must be from {variable.minimum:g} to {variable.maximum:g} "
                f"({variable.unit}: {variable.description})"
            )
    return elements
