"""FMU states, reset and several instances: bit-exact and independent of each other."""

from __future__ import annotations

import pytest
from fmi_driver import FMUS, STEP, Stimulus
from fmpy.fmi1 import FMICallException


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_state_round_trip_is_bit_exact(name, fmi, instantiate):
    instance = instantiate(name, fmi)
    instance.initialise()
    instance.fly(Stimulus(instance, seed=1), 20)
    state, time = instance.fmu.getFMUState(), instance.time
    first = instance.fly(Stimulus(instance, seed=2), 20)
    instance.fmu.setFMUState(state)
    instance.time = time
    assert instance.fly(Stimulus(instance, seed=2), 20) == first
    instance.fmu.freeFMUState(state)


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_serialised_state_continues_in_another_instance(name, fmi, instantiate):
    original, copy = instantiate(name, fmi), instantiate(name, fmi)
    for parameter, values in Stimulus(original).parameters().items():
        original.set(parameter, values)
    original.initialise()
    original.fly(Stimulus(original, seed=1), 20)
    state = original.fmu.getFMUState()
    data = original.fmu.serializeFMUState(state)
    original.fmu.freeFMUState(state)

    state = copy.fmu.deserializeFMUState(data)
    copy.fmu.setFMUState(state)
    assert copy.fmu.serializeFMUState(state) == data
    copy.fmu.freeFMUState(state)
    copy.time = original.time
    assert copy.fly(Stimulus(copy, seed=2), 20) == original.fly(Stimulus(original, seed=2), 20)


@pytest.mark.parametrize("damage", [lambda data: data[:-1], lambda data: b"?" + data[1:], lambda data: b""])
@pytest.mark.parametrize("fmi", [2, 3])
def test_foreign_bytes_are_not_deserialised(fmi, damage, instantiate):
    instance = instantiate("null", fmi)
    state = instance.fmu.getFMUState()
    data = instance.fmu.serializeFMUState(state)
    with pytest.raises(FMICallException):
        instance.fmu.deserializeFMUState(damage(data))
    assert "not a serialised state of this component" in instance.messages[-1]
    instance.fmu.freeFMUState(state)


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_reset_restores_start_values_and_reproduces(name, fmi, instantiate):
    instance = instantiate(name, fmi)
    instance.initialise()
    initial = instance.outputs()
    first = instance.fly(Stimulus(instance), 30)

    instance.fmu.reset()
    for port in instance.ports.values():
        if port.causality != "output":
            assert instance.get(port.name).tolist() == port.start, port.name
    for parameter, values in Stimulus(instance).parameters().items():
        instance.set(parameter, values)  # a reset forgets these, too
    instance.fmu.reset()
    instance.initialise()
    assert instance.outputs() == initial
    assert instance.fly(Stimulus(instance), 30) == first


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_instances_in_one_process_are_independent(name, fmi, instantiate):
    alone = []
    for seed in (1, 2):
        instance = instantiate(name, fmi)
        instance.initialise()
        alone.append(instance.fly(Stimulus(instance, seed), 20))

    pair = [instantiate(name, fmi) for _ in range(2)]
    stimuli = [Stimulus(instance, seed) for instance, seed in zip(pair, (1, 2), strict=True)]
    for instance in pair:
        instance.initialise()
    interleaved: list[list[bytes]] = [[], []]
    for _ in range(20):
        for i in (0, 1):
            interleaved[i] += pair[i].fly(stimuli[i], 1)
    assert interleaved == alone


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_a_long_communication_step_is_many_internal_steps(name, fmi, instantiate):
    once, often = instantiate(name, fmi), instantiate(name, fmi)
    for instance in (once, often):
        instance.initialise(start_time=0.5)
        for port, values in Stimulus(instance).inputs().items():
            instance.set(port, values)
    once.step(10 * STEP)
    for k in range(10):
        often.fmu.doStep(0.5 + k * STEP, STEP)
    assert once.outputs() == often.outputs()
