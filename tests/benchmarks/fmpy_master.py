"""The stepping loop as one would write it with FMPy's own methods: oracle of the native one, and its yardstick."""

from __future__ import annotations

from rotordx.orchestrator.system import System


class FmpyMaster:
    """Steps an initialised system with nothing but methods of FMPy and Python lists."""

    def __init__(self, system: System):
        self.step_size = system.stepper.step_size
        self.columns = system.wiring.columns
        self.bus = system.stepper.bus.tolist()
        self.components = []
        for component in system.stepper.components:
            references = [
                [reference for variable in ports.values() for reference in variable.references]
                for ports in (component.inputs, component.outputs)
            ]
            first = self.columns[f"{component.name}.{next(iter(component.outputs))}"].start
            size = sum(variable.size for variable in component.outputs.values())
            self.components.append((component, system.wiring.inputs[component.name], *references, first, size))

    def signal(self, key: str) -> list[float]:
        """Present values of a signal."""
        return self.bus[self.columns[key]]

    def advance(self, first: int, count: int) -> None:
        """Make `count` steps from t = first * step_size."""
        for step in range(first, first + count):
            time = step * self.step_size
            for component, columns, inputs, outputs, start, size in self.components:
                fmu, values = component.fmu, [self.bus[column] for column in columns]
                if component.fmi == 2:
                    if inputs:
                        fmu.setReal(inputs, values)
                    fmu.doStep(time, self.step_size)
                    self.bus[start : start + size] = fmu.getReal(outputs)
                else:
                    if inputs:
                        fmu.setFloat64(inputs, values)
                    fmu.doStep(time, self.step_size)
                    self.bus[start : start + size] = fmu.getFloat64(outputs, size)
