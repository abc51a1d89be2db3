"""A system of FMUs: loaded and wired once, then parametrised and initialised for one flight after the other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rotordx.fmus import component_names, diagnoser_ids, fmu_path
from rotordx.fmus.vehicles import Vehicle, VehicleError, load_vehicle
from rotordx.orchestrator.archive import Archive, open_archive
from rotordx.orchestrator.component import Component
from rotordx.orchestrator.documents import one_of
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.isolation import IsolatedComponent
from rotordx.orchestrator.layout import ComponentSettings, Connection, SystemLayout, load_layout
from rotordx.orchestrator.metrics import VERDICT
from rotordx.orchestrator.parameters import missing_design, parameter_values
from rotordx.orchestrator.scenario import Scenario
from rotordx.orchestrator.stepper import Stepper
from rotordx.orchestrator.wiring import wire


class System:
    """The FMUs of a scenario and their wiring.

    Loading takes far longer than a flight: for many flights that differ in parameters only (faults, gusts, seed,
    duration, vehicle, parameters of components), make one system and call `initialise` before each.
    """

    def __init__(self, scenario: Scenario):
        """Load, instantiate and wire.

        Raises:
            UserError: an FMU cannot be used, or a connection is impossible.
            ComponentError: an FMU cannot be instantiated.
        """
        self._structure = _structure(scenario)
        self.components: dict[str, Component] = {}
        self.archives: dict[str, Archive] = {}  #: of the components
        with ExitStack() as on_failure, _errors_of(scenario):
            on_failure.callback(self.close)
            self._layout = load_layout(scenario.system)
            for name, settings in self.settings(scenario).items():
                packaged = not str(settings.fmu).endswith(".fmu")
                archive = open_archive(_path(name, settings), trusted=packaged)
                isolated = not packaged if settings.isolate is None else settings.isolate
                self.archives[name] = archive
                self.components[name] = (IsolatedComponent if isolated else Component)(name, archive, settings)
            for name in scenario.diagnosers:
                _check_verdict(name, self.components[name])
            self.connections = _connections(self._layout, scenario, self.components)
            self.wiring = wire(self.components, self.connections)
            ordered = [self.components[name] for name in self.wiring.order]
            self.stepper = Stepper(ordered, self.wiring, scenario.step_size_s)
            on_failure.pop_all()

    def initialise(
        self,
        scenario: Scenario,
        actual_vehicle: Vehicle | None = None,
        external: NDArray[np.float64] | None = None,
    ) -> None:
        """Reset everything and make it ready for the first step of a flight; initial outputs are then on the bus.

        Args:
            scenario: one that differs from the system's in parameters only.
            actual_vehicle: the vehicle as it is, which controller and diagnosers do not know; None: they know it.
            external: initial values of the external signals; None: 0.

        Raises:
            ValueError: the scenario needs another system.
            UserError: a parameter is unknown or does not fit, or the initial values depend on each other in a circle.
            ComponentError: an FMU refuses its parameters or cannot be initialised.
        """
        if _structure(scenario) != self._structure:
            raise ValueError(f"the scenario {scenario.name} has other components or connections than this system")
        with _errors_of(scenario):
            vehicle = load_vehicle(scenario.vehicle)
            settings = self.settings(scenario)
            values = parameter_values(scenario, settings, self.components, vehicle, actual_vehicle or vehicle)
            for name, component in self.components.items():
                component.reset()
                component.messages += filter(None, [missing_design(vehicle, settings[name].fmu)])
                component.set_parameters(values[name])
                component.enter_initialization()
            self.stepper.bus[:] = 0.0
            if external is not None:
                self.stepper.bus[: len(external)] = external
            self._propagate_initial_values()
            for component in self.components.values():
                component.exit_initialization()
            for number in range(len(self.components)):
                self.stepper.get_outputs(number)

    def settings(self, scenario: Scenario) -> dict[str, ComponentSettings]:
        """Settings of all components: the system's, then the diagnosers', each extended by the scenario's.

        Raises:
            UserError: the scenario sets up a component that does not exist.
        """
        settings = self._layout.components | {name: ComponentSettings(fmu=name) for name in scenario.diagnosers}
        for name, own in scenario.components.items():
            settings[name] = settings.get(name, ComponentSettings()).extended(own)
            if settings[name].fmu is None:
                known = one_of([*self._layout.components, *scenario.diagnosers], name)
                raise UserError(f"components.{name} must be {known}, or else it needs an `fmu`")
        if not settings:
            raise UserError(f"the system {scenario.system} is empty without diagnosers, name one")
        return settings

    def signal(self, key: str) -> NDArray[np.float64]:
        """The present values of "component.port", a view of the bus.

        Raises:
            KeyError: there is no such signal.
        """
        return self.stepper.bus[self.wiring.columns[key]]

    def close(self) -> None:
        """Free all FMUs."""
        for component in self.components.values():
            component.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _propagate_initial_values(self) -> None:
        """Pass outputs on to inputs, in the order of computation, until nothing changes.

        Unless initial values depend on each other in a circle, as many rounds as there are components reach
        everywhere, and one more finds that nothing changes.
        """
        bus, numbers = self.stepper.bus, range(len(self.components))
        for number in numbers:
            self.stepper.get_outputs(number)
        for _ in range(len(numbers) + 1):
            before = bus.copy()
            for number in numbers:
                self.stepper.set_inputs(number)
                self.stepper.get_outputs(number)
            changed = (bus != before) & ~(np.isnan(bus) & np.isnan(before))
            if not changed.any():
                return
        keys = ", ".join(key for key, columns in self.wiring.columns.items() if changed[columns].any())
        raise UserError(
            f"the initial values of {keys} depend on each other in a circle, feed one of them from elsewhere"
        )


@contextmanager
def _errors_of(scenario: Scenario) -> Iterator[None]:
    """Errors in what a scenario asks for name the scenario."""
    try:
        yield
    except (UserError, VehicleError) as error:
        raise UserError(f"{scenario.name}: {error}") from error


def _check_verdict(diagnoser: str, component: Component) -> None:
    """Refuse a diagnoser that could not be scored."""
    outputs = component.outputs
    for port, size in VERDICT.items():
        if port in outputs and outputs[port].size != size:
            raise UserError(f"the output {diagnoser}.{port} has {outputs[port].size} elements but must have {size}")
    required = next(iter(VERDICT))
    if required not in outputs:
        raise UserError(
            f"the diagnoser {diagnoser} has no output {required}: say under components.{diagnoser}.ports which of its "
            f"outputs that is, {required} = {one_of(outputs, required)}"
        )
    residual, threshold = (outputs.get(port) for port in ("residual", "threshold"))
    if residual and threshold and residual.size != threshold.size:
        raise UserError(
            f"the outputs {diagnoser}.residual and {diagnoser}.threshold have {residual.size} and {threshold.size} "
            "elements but must have the same number"
        )


def _structure(scenario: Scenario) -> object:
    """What has to be the same in two scenarios that share a system."""
    components = {name: s.model_copy(update={"parameters": {}}) for name, s in scenario.components.items()}
    return scenario.system, scenario.diagnosers, scenario.step_size_s, components, scenario.connections


def _path(name: str, settings: ComponentSettings) -> Path:
    fmu = str(settings.fmu)
    if fmu.endswith(".fmu"):
        return Path(fmu)
    known = [*component_names(), *diagnoser_ids()]
    if fmu not in known:
        raise UserError(
            f"components.{name}.fmu is {fmu!r} but must be {one_of(known, fmu)}, or the path of an .fmu file"
        )
    try:
        return fmu_path(fmu, settings.fmi or 3)
    except FileNotFoundError as error:
        raise UserError(f"components.{name}.fmu: {error}") from error


def _connections(layout: SystemLayout, scenario: Scenario, components: Mapping[str, Component]) -> list[Connection]:
    """The scenario's connections, and those of the system whose targets they leave.

    Where the scenario puts an FMU of its own in a component's place, connections of the system to inputs which that
    does not have fall away.
    """
    standard = [
        *layout.connections,
        *(
            Connection.model_validate({"from": source, "to": f"{diagnoser}.{port}"})
            for diagnoser in scenario.diagnosers
            for port, source in layout.diagnoser_inputs.items()
        ),
    ]
    targets = {connection.target for connection in scenario.connections}
    for name, own in scenario.components.items():
        if own.fmu is not None:
            targets |= {c.target for c in standard if c.target.partition(".")[0] == name} - {
                f"{name}.{port}" for port in components[name].inputs
            }
    return [*(connection for connection in standard if connection.target not in targets), *scenario.connections]
