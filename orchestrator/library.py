"""FMUs whose library lacks functions that it need not have: FMPy loads them all or none."""

from __future__ import annotations

from collections.abc import Callable
from ctypes import CDLL, CFUNCTYPE, c_int
from typing import Any

ERROR = 3  #: the status of both versions of FMI

#: Without these, no instance can be made, stepped and used again.
_NEEDED = {
    2: {
        *("fmi2Instantiate", "fmi2FreeInstance", "fmi2SetupExperiment", "fmi2EnterInitializationMode"),
        *("fmi2ExitInitializationMode", "fmi2DoStep", "fmi2Reset"),
    },
    3: {
        *("fmi3InstantiateCoSimulation", "fmi3FreeInstance", "fmi3EnterInitializationMode"),
        *("fmi3ExitInitializationMode", "fmi3DoStep", "fmi3Reset"),
    },
}


class _Functions:
    """The functions of a library; one that is missing and not needed returns an error when it is called."""

    def __init__(self, dll: CDLL, missing: Callable[[str], None]):
        self._dll = dll
        self._missing = missing
        self._stubs: dict[str, Any] = {}

    def __getattr__(self, name: str) -> Any:
        if not name.startswith("fmi"):
            return getattr(self._dll, name)
        if name in self._stubs:
            return self._stubs[name]
        try:
            return getattr(self._dll, name)
        except AttributeError:
            if name in _NEEDED[int(name[3])]:
                raise
            return self._stubs.setdefault(name, self._stub(name))

    def _stub(self, name: str) -> Any:
        def complain() -> int:
            self._missing(f"its library has no function {name}")
            return ERROR

        return CFUNCTYPE(c_int)(complain)


def with_optional_functions(kind: Any, missing: Callable[[str], None]) -> Any:
    """FMPy's class of an FMU, but one that loads libraries with gaps.

    Args:
        kind: fmpy.fmi2.FMU2Slave or fmpy.fmi3.FMU3Slave.
        missing: called with a sentence when somebody calls a function that the library does not have.
    """

    def load_functions(fmu: Any) -> None:
        fmu.dll = _Functions(fmu.dll, missing)
        kind._loadFunctions(fmu)

    return type(kind.__name__, (kind,), {"_loadFunctions": load_functions})  # FMPy goes by the name of the class
