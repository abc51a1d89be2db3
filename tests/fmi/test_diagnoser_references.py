"""Every diagnoser FMU says what its reference.csv records, and that file is what the CasADi function says today."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from rotordx.fmus import diagnoser_ids
from rotordx.fmus.diagnosers import reference


@pytest.mark.parametrize("name", diagnoser_ids())
def test_fmu_follows_its_reference(name, instantiate):
    with reference.reference_file(name).open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == reference.columns(name), "write it anew: python -m rotordx.fmus.diagnosers.reference"
    recorded = np.array(rows, float)
    instance = instantiate(name, 3)
    inputs, outputs = instance.names("input"), instance.names("output")
    instance.set("step_size", reference.STEP_SIZE)
    instance.initialise()
    replayed = []
    for row in recorded:
        offset = 1
        for port in inputs:
            width = len(instance.get(port))
            instance.set(port, row[offset : offset + width])
            offset += width
        instance.step(reference.STEP_SIZE)
        replayed.append([*row[:offset], *(value for port in outputs for value in instance.get(port))])
    np.testing.assert_allclose(replayed, recorded, rtol=1e-9, atol=1e-10)


@pytest.mark.parametrize("name", diagnoser_ids())
def test_reference_is_current(name):
    with reference.reference_file(name).open(encoding="utf-8", newline="") as file:
        recorded = np.array(list(csv.reader(file))[1:], float)
    np.testing.assert_allclose(np.array(list(reference.rows(name)), float), recorded, rtol=1e-9, atol=1e-10)
