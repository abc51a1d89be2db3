"""ModelStructure tells the truth: outputs change only in a step; initial outputs follow only what is declared."""

from __future__ import annotations

import numpy as np
import pytest
from fmi_driver import FMUS, Stimulus


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_no_output_depends_on_an_input_without_a_step(name, fmi, instantiate):
    instance = instantiate(name, fmi)
    assert len(instance.description.outputs) == len(
        [v for v in instance.description.modelVariables if v.causality == "output"]
    )
    assert all(unknown.dependencies == [] for unknown in instance.description.outputs)
    instance.initialise()
    instance.fly(Stimulus(instance, seed=1), 10)
    before = instance.outputs()
    for port, values in Stimulus(instance, seed=2).inputs().items():
        instance.set(port, values)
    assert instance.outputs() == before


@pytest.mark.parametrize(("name", "fmi"), FMUS)
def test_initial_outputs_depend_on_what_is_declared(name, fmi, instantiate):
    """Every input and parameter, moved alone in initialisation mode, moves only outputs that list it."""
    instance = instantiate(name, fmi)
    unknowns = {u.variable.name.split("[")[0]: u for u in instance.description.initialUnknowns}
    assert sorted(unknowns) == sorted(instance.names("output"))
    declared = {
        output: {known.name.split("[")[0] for known in unknown.dependencies} for output, unknown in unknowns.items()
    }
    stimulus = Stimulus(instance)
    perturbed = {**stimulus.inputs(), **stimulus.parameters()}
    instance.enter_initialisation()
    reference = instance.all("output")
    for known, values in perturbed.items():
        start = instance.get(known)
        instance.set(known, values)
        for output, value in instance.all("output").items():
            if known not in declared[output]:
                np.testing.assert_array_equal(value, reference[output], err_msg=f"{output} depends on {known}")
        instance.set(known, start)


@pytest.mark.parametrize("fmi", [2, 3])
def test_initial_outputs_follow_inputs_where_declared(fmi, instantiate):
    instance = instantiate("esc", fmi)
    instance.enter_initialisation()
    for speeds in ([400, 410, 420, 430], [500, 510, 520, 530]):  # as an importer that iterates would set them
        instance.set("rotor_speed_command", speeds)
        assert instance.get("rotor_speed").tolist() == speeds
    instance.fmu.exitInitializationMode()
    assert instance.get("rotor_speed").tolist() == [500, 510, 520, 530]
