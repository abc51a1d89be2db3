"""On an emulated Cortex-M7 a flight gives the FMU's outputs to 1e-12, single precision its verdict; within budget."""

import numpy as np
import pytest

from tests.c_export.table import CLOSING, README
from tests.c_export.toolchain import (
    EMULATOR,
    cortex_m7_program,
    flown,
    loss_difference,
    measured_steps,
    played,
    same_verdict,
)

CODE_BYTES, STACK_BYTES, INSTRUCTIONS = 64 * 1024, 4 * 1024, 8000
SHORT = {"duration_s": 9.5, "faults": [{"rotor": 2, "onset_s": 8.0, "loss_of_effectiveness": 0.2}]}


@pytest.mark.parametrize("precision", ["double", "single"])
def test_flight_on_the_emulated_processor(exported, precision, tmp_path):
    inputs, answers = flown(exported.diagnoser, **SHORT)
    sizes = cortex_m7_program(exported, precision, tmp_path)
    outputs = played(EMULATOR, inputs, tmp_path)
    steps = measured_steps(tmp_path)
    if precision == "double":
        assert np.array_equal(np.isnan(outputs), np.isnan(answers))
        assert (np.abs(outputs - answers) <= 1e-12 * (1 + np.abs(answers)))[~np.isnan(answers)].all()
    assert same_verdict(outputs, answers, exported.subject.step_size)
    assert loss_difference(outputs, answers) < 1e-3
    print(f"{exported.diagnoser} {precision}: {sizes} {steps}")
    assert sizes["code_bytes"] <= CODE_BYTES
    assert max(sizes["stack_bytes"], steps["deepest_stack_bytes"]) <= STACK_BYTES
    assert 0 < steps["instructions"] <= steps["most_instructions"]
    assert steps["most_instructions"] <= INSTRUCTIONS or f"`{exported.diagnoser}`" in reasons()


def reasons() -> str:
    """What is said below the table of why a diagnoser takes more."""
    return README.read_text(encoding="utf-8").partition(CLOSING)[2]
