"""Instances come and go without a trace in memory, also from several threads at once."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest

from rotordx.fmus import component_names, diagnoser_ids

CYCLES = 1000
SMALLEST = 200  #: bytes, less than any instance takes

#: Prints how many more bytes of the heap are in use after the cycles than before; run with one heap for all threads.
CHILD = """
import ctypes, json, sys
from concurrent.futures import ThreadPoolExecutor

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave
from rotordx.fmus import fmu_path

fmi, cycles, names = int(sys.argv[1]), int(sys.argv[2]), sys.argv[3:]


class Info(ctypes.Structure):
    _fields_ = [(name, ctypes.c_size_t) for name in
                "arena ordblks smblks hblks hblkhd usmblks fsmblks uordblks fordblks keepcost".split()]


information = ctypes.CDLL(None).mallinfo2
information.restype = Info


def cycle(fmu):
    free = fmu.fmi2FreeInstance if fmi == 2 else fmu.fmi3FreeInstance
    fmu.instantiate()
    if fmi == 2:
        fmu.setupExperiment(startTime=0.0)
    fmu.enterInitializationMode()
    fmu.exitInitializationMode()
    fmu.doStep(0.0, 0.002)
    free(fmu.component)


def used():
    return information().uordblks


growth = {}
with ThreadPoolExecutor(4) as pool:
    for name in names:
        description = fmpy.read_model_description(str(fmu_path(name, fmi)), validate=False)
        folder = fmpy.extract(str(fmu_path(name, fmi)))
        arguments = dict(guid=description.guid, modelIdentifier=name, unzipDirectory=folder)
        fmus = [(FMU2Slave if fmi == 2 else FMU3Slave)(instanceName=str(i), **arguments) for i in range(4)]

        def work(fmu, count):
            for _ in range(count):
                cycle(fmu)

        list(pool.map(lambda fmu: work(fmu, 25), fmus))
        before = used()
        work(fmus[0], cycles)
        alone = used() - before
        before = used()
        list(pool.map(lambda fmu: work(fmu, cycles // 4), fmus))
        growth[name] = alone, used() - before
print(json.dumps(growth))
"""


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_thousand_instances_leave_nothing_behind(fmi):
    names = [*component_names(), *diagnoser_ids()]
    command = [sys.executable, "-c", CHILD, str(fmi), str(CYCLES), *names]
    environment = os.environ | {"MALLOC_ARENA_MAX": "1", "PYTHONMALLOC": "malloc"}
    result = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert result.returncode == 0, result.stderr
    growth = json.loads(result.stdout)
    assert set(growth) == set(names)
    for name, (alone, in_threads) in growth.items():
        assert max(alone, in_threads) < CYCLES * SMALLEST / 2, name
