"""What an FMU refuses: an error status, a message that names the matter, and an unchanged state."""

from __future__ import annotations

import numpy as np
import pytest
from fmi_driver import FMUS, STEP, Stimulus
from fmpy.fmi1 import FMICallException

VERSIONS = pytest.mark.parametrize("fmi", [2, 3])


def serialised(instance) -> bytes:
    state = instance.fmu.getFMUState()
    data = instance.fmu.serializeFMUState(state)
    instance.fmu.freeFMUState(state)
    return data


def refused(instance, call, *arguments) -> str:
    """Message of a call that must be refused and change nothing."""
    before = serialised(instance)
    instance.messages.clear()
    with pytest.raises(FMICallException, match="error"):
        call(*arguments)
    assert serialised(instance) == before
    [message] = instance.messages
    assert message.startswith("logStatusError: ")
    return message


@pytest.mark.parametrize("step", [0.0, -STEP, 0.5 * STEP, 1.5 * STEP, np.nan, np.inf])
@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_a_step_that_is_no_multiple_of_step_size(name, fmi, step, instantiate):
    instance = instantiate(name, fmi)
    instance.initialise()
    message = refused(instance, instance.step, step)
    assert "is not a multiple of step_size = 0.002 s" in message


@VERSIONS
def test_a_step_that_begins_elsewhere(fmi, instantiate):
    instance = instantiate("null", fmi)
    instance.initialise()
    assert "to begin at t = 1 s, but this instance is at t = 0 s" in refused(instance, instance.fmu.doStep, 1.0, STEP)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_a_value_that_is_not_finite(name, fmi, value, instantiate):
    instance = instantiate(name, fmi)
    writable = [p for p in instance.ports.values() if p.causality != "output" and not p.enumeration]
    for port in writable:
        values = instance.get(port.name)
        values[-1] = value
        message = refused(instance, instance.set, port.name, values)
        assert f"{port.elements[-1]} cannot be" in message
        assert "finite" in message
    instance.initialise()
    not_reported_yet = [n for n, v in instance.all("output").items() if np.isnan(v).any()]
    for port in [p for p in writable if p.causality == "input"]:
        values = instance.get(port.name)
        values[0] = value
        assert f"{port.elements[0]} cannot be" in refused(instance, instance.set, port.name, values)
    instance.fly(Stimulus(instance), 10)
    values = instance.all("input", "parameter", "output")
    assert {n for n, v in values.items() if not np.isfinite(v).all()} <= set(not_reported_yet)


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_parameters_out_of_range(name, fmi, instantiate):
    instance = instantiate(name, fmi)
    for port in instance.ports.values():
        if port.causality != "parameter" or port.enumeration:
            continue
        for bound, beyond in ((port.minimum, port.minimum - 1), (port.maximum, 2 * port.maximum + 1)):
            if np.isfinite(bound):
                message = refused(instance, instance.set, port.name, [beyond] * len(port.references))
                assert f"{port.elements[0]} cannot be" in message
                assert "it must be in [" in message


@VERSIONS
def test_parameters_that_contradict_each_other(fmi, instantiate):
    instance = instantiate("controller", fmi)
    instance.enter_initialisation()
    instance.set("rotor_speed_min", 1000.0)
    sentence = "logStatusError: rotor_speed_min must be below rotor_speed_max"
    assert refused(instance, instance.fmu.exitInitializationMode) == sentence
    assert refused(instance, instance.get, "rotor_speed_command") == sentence
    instance.set("rotor_speed_min", 100.0)
    instance.fmu.exitInitializationMode()


@VERSIONS
def test_enumeration_values_that_do_not_exist(fmi, instantiate):
    instance = instantiate("reference", fmi)
    for value in (-1, 6):
        assert "trajectory cannot be" in refused(instance, instance.set, "trajectory", value)


@VERSIONS
def test_one_bad_value_among_many_stores_none(fmi, instantiate):
    instance = instantiate("null", fmi)
    instance.initialise()
    references = [reference for name in instance.names("input") for reference in instance.ports[name].references]
    values = [1.0] * (len(references) - 1) + [np.nan]
    if fmi == 2:
        message = refused(instance, instance.fmu.setReal, references, values)
    else:
        starts = [instance.ports[name].references[0] for name in instance.names("input")]
        message = refused(instance, instance.fmu.setFloat64, starts, values)
    assert "vertical_velocity" in message


@VERSIONS
def test_outputs_cannot_be_set(fmi, instantiate):
    instance = instantiate("null", fmi)
    assert "fault_detected is an output" in refused(instance, instance.set, "fault_detected", 1.0)


@VERSIONS
def test_variability_is_kept(fmi, instantiate):
    fixed, tunable = instantiate("esc", fmi), instantiate("null", fmi)
    for instance in (fixed, tunable):
        instance.initialise()
        assert "step_size is a fixed parameter" in refused(instance, instance.set, "step_size", 0.001)
    assert fixed.ports["battery_sag_rate"].variability == "fixed"
    assert "is a fixed parameter" in refused(fixed, fixed.set, "battery_sag_rate", 0.1)
    assert tunable.ports["constant_threshold"].variability == "tunable"
    tunable.set("constant_threshold", 3.0)
    tunable.step()
    assert tunable.get("threshold").tolist() == [3.0] * 4


@VERSIONS
def test_value_references_of_other_types_and_sizes(fmi, instantiate):
    instance = instantiate("null", fmi)
    beyond = 10_000
    if fmi == 2:
        real, integer = instance.fmu.getReal, instance.fmu.getInteger
    else:
        real, integer = instance.fmu.getFloat64, instance.fmu.getInt64
        assert "do not match" in refused(instance, real, [0], 3)  # the port has four elements
        assert "do not match" in refused(instance, real, [0], 5)
        assert "value reference 1 is not" in refused(instance, real, [1], 4)  # not the first element
    assert "value reference 10000 is not a variable of this type" in refused(instance, real, [beyond])
    assert "value reference 11 is not a variable of this type" in refused(instance, integer, [11])


@VERSIONS
def test_calls_out_of_turn(fmi, instantiate):
    instance = instantiate("null", fmi)
    fmu = instance.fmu
    assert "reading outputs is not allowed while the instance is instantiated" in refused(
        instance, instance.get, "fault_detected"
    )
    for call in (fmu.exitInitializationMode, fmu.terminate, instance.step):
        assert "is not allowed while the instance is instantiated" in refused(instance, call)
    instance.enter_initialisation()
    assert "is not allowed while the instance is in initialisation mode" in refused(instance, instance.step)
    fmu.exitInitializationMode()
    for call in (fmu.enterInitializationMode, fmu.exitInitializationMode):
        assert "is not allowed while the instance is in step mode" in refused(instance, call)
    fmu.terminate()
    assert instance.get("fault_detected") == 0
    assert "is not allowed while the instance is terminated" in refused(instance, instance.step)
    assert "is not allowed while the instance is terminated" in refused(instance, instance.set, "euler", [0] * 3)
    fmu.reset()
    instance.initialise()


@VERSIONS
def test_start_and_stop_times_that_make_no_sense(fmi, instantiate):
    instance = instantiate("null", fmi)
    setup = instance.fmu.setupExperiment if fmi == 2 else instance.fmu.enterInitializationMode
    for times, message in (
        ({"startTime": np.nan}, "start time nan s is not finite"),
        ({"startTime": 2.0, "stopTime": 1.0}, "stop time 1 s lies before the start time 2 s"),
    ):
        assert message in refused(instance, lambda times=times: setup(**times))


@VERSIONS
def test_a_model_description_of_another_build(fmi, instantiate):
    messages = []
    with pytest.raises(Exception, match="Failed to instantiate"):
        instantiate("null", fmi, token="{0}", messages=messages)
    [message] = messages
    assert message.startswith("logStatusError: null: the model description ({0}) does not belong to this library")


@VERSIONS
def test_what_is_not_supported_says_so(fmi, instantiate):
    instance = instantiate("null", fmi)
    if fmi == 2:
        calls = {
            "fmi2GetBoolean": lambda: instance.fmu.getBoolean([0]),
            "fmi2CancelStep": instance.fmu.cancelStep,
            "fmi2GetDirectionalDerivative": lambda: instance.fmu.getDirectionalDerivative([0], [0], [1.0]),
        }
    else:
        calls = {
            "fmi3GetFloat32": lambda: instance.fmu.getFloat32([0]),
            "fmi3EnterStepMode": instance.fmu.enterStepMode,
            "fmi3EnterConfigurationMode": lambda: instance.fmu.fmi3EnterConfigurationMode(instance.fmu.component),
            "fmi3GetDirectionalDerivative": lambda: instance.fmu.getDirectionalDerivative([0], [0], [1.0]),
        }
    for name, call in calls.items():
        assert f"{name} is not supported" in refused(instance, call)


@VERSIONS
def test_debug_logging_tells_the_life_cycle(fmi, instantiate):
    quiet, talking = instantiate("null", fmi), instantiate("null", fmi, debug=True)
    for instance in (quiet, talking):
        instance.initialise()
        instance.fmu.terminate()
    assert quiet.messages == []
    assert [m.split(": ")[0] for m in talking.messages] == ["logEvents"] * 3
    assert [m.split()[1] for m in talking.messages] == ["instantiated", "initialised", "terminated"]
