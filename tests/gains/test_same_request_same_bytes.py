"""The same request gives the same design: the same bytes on one machine, the same to four digits on any processor."""

import os
import subprocess
import sys

import pytest

from rotordx.gains.certificate import text
from rotordx.gains.packaged import make, packaged_designs, same
from rotordx.gains.rounding import rounded, rounded_down, rounded_form, rounded_rows

MAKE = "import sys; from rotordx.gains.packaged import make; from rotordx.gains.certificate import text; " + (
    "sys.stdout.write(text(make(*sys.argv[1:])))"
)


@pytest.mark.parametrize("diagnoser", ["rho_adaptive", "adaptive_thau", "msjfo"])
def test_two_processes_write_the_same_bytes(diagnoser):
    environment = {key: value for key, value in os.environ.items() if key != "OPENBLAS_CORETYPE"}
    command = [sys.executable, "-c", MAKE, "lab_x", diagnoser]
    first, second = (subprocess.run(command, capture_output=True, check=True, env=environment).stdout for _ in range(2))
    assert first == second
    assert len(first) > 1000


@pytest.mark.parametrize("diagnoser", ["rho_adaptive", "adaptive_thau", "hinf"])
def test_another_processor_makes_the_same_design(diagnoser, tmp_path):
    environment = os.environ | {"OPENBLAS_CORETYPE": "Prescott"}  # linear algebra without the vector units of today
    command = [sys.executable, "-c", MAKE, "ren_plus", diagnoser]
    path = tmp_path / "design.json"
    path.write_bytes(subprocess.run(command, capture_output=True, check=True, env=environment).stdout)
    assert same(make("ren_plus", diagnoser), path)


def test_a_changed_design_is_not_taken_for_the_same(tmp_path):
    design = make("lab_x", "msjfo")
    path = packaged_designs() / "lab_x" / "msjfo.json"
    assert same(design, path)
    changed = tmp_path / "changed.json"
    changed.write_text(text(design).replace("0.220611", "0.220711").replace("0.001", "0.002"), encoding="utf-8")
    assert not same(design, changed)
    assert not same(design, tmp_path / "missing.json")


def test_rounding_keeps_what_matters():
    import numpy as np

    assert rounded(np.array([1.0, 1e-15])).tolist() == [1.0, 0.0]
    assert rounded(1.23456789, 3) == 1.23
    assert rounded_down(0.0450429) == 0.045042
    assert rounded_rows(np.array([[123.4567891, 1e-9], [0.0, 0.0]])).tolist() == [[123.457, 0.0], [0.0, 0.0]]
    form = rounded_form(np.array([[4.0, 1e-9], [2e-9, 1e-8]]), 3)
    assert form.tolist() == form.T.tolist() == [[4.0, 0.0], [0.0, 1e-8]]
