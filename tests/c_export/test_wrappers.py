"""The wrappers compile against minimal headers of their firmware, and know the order of its motors."""

import itertools
import re

import numpy as np
import pytest

from rotordx.fmus.vehicles import load_vehicle
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.export.wrappers import rotor_of_motor
from tests.c_export.toolchain import CORTEX_M4F, HERE, STRICT, run

STUBS = HERE / "stubs"
SINGLE = [*CORTEX_M4F, "-O1", "-ffp-contract=off", "-DROTORDX_SINGLE", "-Werror"]
MEMBERS = {
    "uint64": "uint64_t",
    "uint8": "uint8_t",
    "int8": "int8_t",
    "float32": "float",
    "float32[4]": "float",
    "bool": "bool",
}


@pytest.mark.parametrize(
    ("wrapper", "source", "stubs"),
    [("rtos", "rotordx_task.c", ["freertos"]), ("crazyflie", "app_main.c", ["crazyflie", "freertos"])],
)
def test_c_wrappers_compile(exported, wrapper, source, stubs, tmp_path):
    folder = exported.folder / wrapper
    include = [f"-I{STUBS / stub}" for stub in stubs]
    strict = [flag for flag in STRICT if flag != "-pedantic"]
    run([*SINGLE, *strict, *include, f"-I{folder}", f"-I{exported.folder}", "-c", folder / source, "-o", "o"], tmp_path)


def test_px4_module_compiles(exported, tmp_path):
    folder, topics = exported.folder / "px4", tmp_path / "uORB" / "topics"
    topics.mkdir(parents=True)
    (topics / "rotordx_diagnosis.h").write_text(topic_header((folder / "RotordxDiagnosis.msg").read_text()))
    flags = [
        "-std=gnu++14",
        "-fno-exceptions",
        "-fno-rtti",
        "-fno-threadsafe-statics",
        "-Wall",
        "-Wextra",
        "-Wno-psabi",
    ]
    include = [f"-I{STUBS / 'px4'}", f"-I{tmp_path}", f"-I{folder}", f"-I{exported.folder}"]
    run(
        ["arm-none-eabi-g++", *SINGLE[1:], *flags, *include, "-c", folder / "rotordx_diagnoser.cpp", "-o", "o"],
        tmp_path,
    )


def topic_header(message: str) -> str:
    """The struct that PX4 generates of a message."""
    members = []
    for kind, name in re.findall(r"^(\S+) (\w+)", message, re.MULTILINE):
        length = re.search(r"\[\d+\]", kind)
        members.append(f"  {MEMBERS[kind]} {name}{length[0] if length else ''};\n")
    return "#pragma once\n#include <cstdint>\nstruct rotordx_diagnosis_s {\n" + "".join(members) + "};\n"


@pytest.mark.parametrize("vehicle", ["lab_x", "crazyflie"])
@pytest.mark.parametrize("autopilot", ["px4", "crazyflie"])
def test_motors_are_where_the_autopilot_has_them(vehicle, autopilot):
    """Front right is motor 1 of both; then PX4 goes to the opposite corner, Bitcraze clockwise."""
    body = load_vehicle(vehicle).parameters
    places = np.sign(np.column_stack((body["rotor_x"], body["rotor_y"])))[
        rotor_of_motor(load_vehicle(vehicle), autopilot)
    ]
    assert places[0].tolist() == [1, 1]
    if autopilot == "px4":
        assert places[1].tolist() == [-1, -1]
        assert places[2].tolist() == [1, -1]
    else:
        for before, after in itertools.pairwise(places):  # a quarter turn to the right in axes front, right
            assert after.tolist() == [-before[1], before[0]]


def test_bitcraze_order_is_that_of_its_vehicle():
    assert rotor_of_motor(load_vehicle("crazyflie"), "crazyflie") == [0, 1, 2, 3]


def test_a_plus_frame_is_refused():
    with pytest.raises(UserError, match="quad X, which f450_plus is not: export without it"):
        rotor_of_motor(load_vehicle("f450_plus"), "px4")


@pytest.mark.xdist_group("c_export_fdie")
def test_signals_are_what_a_diagnoser_expects(exports, tmp_path):
    """Euler angles of a quaternion, and the velocity filter's step response against its formula."""
    folder = exports("fdie").folder
    (tmp_path / "signals.c").write_text(
        """#include <stdio.h>
#include "rotordx_signals.h"
int main(void) {
  const float q[4] = {0.9508684854F, -0.0016299991F, 0.2517899737F, 0.1801340493F};
  rotordx_real euler[3];
  rotordx_euler(q, euler);
  printf("%.7f %.7f %.7f\\n", (double)euler[0], (double)euler[1], (double)euler[2]);
  rotordx_velocity_filter filter = {0, 0};
  for (int k = 0; k < 50; ++k) rotordx_filtered(&filter, 1, 0.002F);
  printf("%.7f\\n", (double)filter.value);
  return 0;
}
"""
    )
    run(["gcc", "-std=c99", f"-I{folder / 'px4'}", f"-I{folder}", "signals.c", "-lm", "-o", "signals"], tmp_path)
    euler, value = run([tmp_path / "signals"]).splitlines()
    assert np.allclose([float(angle) for angle in euler.split()], [0.1, 0.5, 0.4], atol=1e-6)
    w, t = 20.0, 0.1
    assert np.isclose(float(value), 1 - np.exp(-w * t) * (1 + w * t), atol=1e-6)
