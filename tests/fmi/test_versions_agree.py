"""FMI 2.0 and FMI 3.0 give the same outputs, bit by bit."""

from __future__ import annotations

import pytest
from fmi_driver import NAMES, Stimulus


@pytest.mark.parametrize("name", NAMES)
def test_bit_identical_under_random_inputs_and_parameters(name, instantiate):
    histories = []
    for fmi in (2, 3):
        instance = instantiate(name, fmi)
        stimulus = Stimulus(instance)
        for parameter, values in stimulus.parameters().items():
            instance.set(parameter, values)
        instance.initialise()
        histories.append([instance.outputs(), *instance.fly(stimulus, 100)])
    assert histories[0] == histories[1]


@pytest.mark.parametrize("name", NAMES)
def test_enumerations_select_the_same_in_both_versions(name, instantiate):
    instances = [instantiate(name, fmi) for fmi in (2, 3)]
    for port in [p for p in instances[0].ports.values() if p.enumeration]:
        for choice, _ in enumerate(port.choices):
            histories = []
            for instance in instances:
                instance.fmu.reset()
                instance.set(port.name, choice)
                assert instance.get(port.name) == choice
                instance.initialise()
                histories.append(instance.fly(Stimulus(instance), 5))
            assert histories[0] == histories[1]
