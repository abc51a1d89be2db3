"""An FMU instance in a process of its own, which may crash or hang without taking the run with it.

The two processes talk over a pair of sockets. A step is one message each way, of inputs and outputs as float64;
everything else, and the answer to a step in which the FMU has logged something, is JSON.
"""

from __future__ import annotations

import json
import os
import signal
import socket
import struct
import subprocess
import sys
from collections.abc import Mapping, Sequence
from ctypes import CFUNCTYPE, c_bool, c_double, c_int, c_size_t, c_void_p, cast, memmove
from dataclasses import replace
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from numpy.typing import NDArray

from rotordx.orchestrator.archive import Archive
from rotordx.orchestrator.component import FATAL, Component, ComponentError
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.layout import ComponentSettings
from rotordx.orchestrator.recording import SignalInfo
from rotordx.orchestrator.stepper import Stepper
from rotordx.orchestrator.variables import Element, Variable
from rotordx.orchestrator.wiring import EXTERNAL, Wiring

TIMEOUT_S = 10.0  #: of a call, if the component's settings do not state one
START_UP_S = 60.0  #: a process may take this long to start, besides the FMU's own time

_STEP, _CALL = b"s", b"c"  # the first byte of a message
_HEAD = 24  # bytes before the inputs: the kind of message, time and step size in s

_Exchange = CFUNCTYPE(c_int, c_void_p, c_void_p, c_size_t, c_void_p, c_size_t)
_DoStep = CFUNCTYPE(c_int, c_void_p, c_double, c_double, c_bool, *[c_void_p] * 4)


class IsolatedComponent(Component):
    """A component whose FMU another process runs; to the native stepper it is one of FMI 3 with functions of ours."""

    def _load(self, archive: Archive, settings: ComponentSettings) -> None:
        if os.name != "posix":
            raise UserError(f"components.{self.name}.isolate: this system cannot isolate FMUs, set it to false")
        self._timeout = settings.timeout_s or TIMEOUT_S
        self._error: BaseException | None = None
        self._birth = [self.name, str(archive.path), str(archive.folder), settings.model_dump(exclude_none=True)]
        self._start()
        self.fmi, self.substeps = 3, 1  # of the functions that the stepper calls
        self.variables = {v.name: _plain(v, i) for i, v in enumerate(self.variables.values())}
        self._inputs = np.zeros(sum(v.size for v in self.inputs.values()))
        self._outputs = np.zeros(sum(v.size for v in self.outputs.values()))
        self._functions = {
            "fmi3SetFloat64": _Exchange(self._keep_inputs),
            "fmi3DoStep": _DoStep(self._do_step),
            "fmi3GetFloat64": _Exchange(self._give_outputs),
        }

    def _start(self) -> None:
        """Start the other process and let it make its instance."""
        self._socket, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
            )
        self._connection = Connection(os.dup(self._socket.fileno()))
        try:
            self._limit_waiting(START_UP_S + self._timeout)
            self._call("instantiation", "", *self._birth)
            self._limit_waiting(self._timeout)
        except BaseException:
            self.close()
            raise

    @property
    def instance(self) -> c_void_p:
        """None: our functions know what they belong to."""
        return c_void_p()

    def function(self, fmi2: str, fmi3: str) -> c_void_p:
        """Address of a function that passes the call on."""
        return cast(self._functions[fmi3], c_void_p)

    def reset(self) -> None:
        """Back to the state after instantiation."""
        self.messages.clear()
        if self._process.poll() is None:
            self._call("reset", "reset")
        else:
            self.close()
            self._start()

    def set_parameters(self, values: Mapping[str, Sequence[Any]]) -> None:
        """Set the elements of parameters by name, between a reset and the initialisation."""
        self._call("setting parameters", "set_parameters", {name: list(elements) for name, elements in values.items()})

    def enter_initialization(self) -> None:
        """Enter initialisation mode, at t = 0."""
        self._call("entering initialisation mode", "enter_initialization")

    def exit_initialization(self) -> None:
        """Leave initialisation mode, ready to step."""
        self._call("initialisation", "exit_initialization")

    def set_inputs(self, values: Sequence[float]) -> None:
        """Set all inputs, in the order of `inputs`."""
        self._call("setting inputs", "set_inputs", list(values))

    def get_outputs(self) -> list[float]:
        """All outputs, in the order of `outputs`."""
        values: list[float] = self._call("reading outputs", "get_outputs")
        return values

    def failure(self, activity: str, time: float, status: int) -> ComponentError:
        """What went wrong in the other process.

        Raises:
            BaseException: what interrupted this process while it was waiting, Ctrl-C for example.
        """
        error, self._error = self._error, None
        if isinstance(error, ComponentError):
            return error
        if error is not None:
            raise error
        return super().failure(activity, time, status)

    def close(self) -> None:
        """End the other process, which frees the FMU if it can."""
        self._connection.close()
        self._socket.close()
        try:
            self._process.wait(min(self._timeout, 1.0))
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _limit_waiting(self, seconds: float) -> None:
        limit = struct.pack("@ll", int(seconds), int(seconds % 1 * 1e6))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)

    def _keep_inputs(self, _: int, references: int, count: int, values: int, size: int) -> int:
        memmove(self._inputs.ctypes.data, values, 8 * size)
        return 0

    def _give_outputs(self, _: int, references: int, count: int, values: int, size: int) -> int:
        memmove(values, self._outputs.ctypes.data, 8 * size)
        return 0

    def _do_step(self, _: int, time: float, step_size: float, *__: Any) -> int:
        """A step, called from C, where an exception would get lost: `failure` raises it."""
        try:
            head = _STEP.ljust(8) + struct.pack("=dd", time, step_size)
            reply = self._exchange("doStep", time, head + self._inputs.tobytes())
            self._outputs[:] = np.frombuffer(reply, offset=8) if reply[:1] == _STEP else self._answer(reply)
        except BaseException as error:
            if not isinstance(error, ComponentError):
                self._process.kill()  # its answer must not be taken for the next one
            self._error = error
            return FATAL
        return 0

    def _call(self, activity: str, method: str, *arguments: Any) -> Any:
        """Call a method of the component in the other process."""
        message = _CALL + json.dumps([method, arguments]).encode()
        return self._answer(self._exchange(activity, 0.0, message))

    def _answer(self, reply: bytes) -> Any:
        """Result of a call; what the FMU has logged is kept.

        Raises:
            ComponentError: the call failed.
        """
        answer = json.loads(reply[1:])
        self.messages[:] = answer["messages"]
        if "error" in answer:
            raise ComponentError(self.name, **answer["error"])
        return answer.get("result")

    def _exchange(self, activity: str, time: float, message: bytes) -> bytes:
        """Send a message and wait for its reply.

        Raises:
            ComponentError: the other process has crashed or does not answer in time.
        """
        try:
            self._connection.send_bytes(message)
            return self._connection.recv_bytes()
        except BlockingIOError:
            self._process.kill()
            self._process.wait()
            what = f"it did not answer within {self._timeout:g} s and was stopped (timeout_s)"
        except (EOFError, OSError):
            what = _cause(self._process.wait())
        raise ComponentError(self.name, time, activity, [*self.messages, what])


def _plain(variable: Variable, reference: int) -> Variable:
    """The variable as the other process gives it: converted, and behind a value reference of its own."""
    return replace(variable, elements=tuple(Element(reference, i, variable.size) for i in range(variable.size)))


def _cause(exit_code: int) -> str:
    return f"it ended with exit code {exit_code}" if exit_code >= 0 else f"it crashed: {signal.strsignal(-exit_code)}"


class _Server:
    """The other process: one component, and steppers that are fed from outside."""

    def __init__(self, name: str, path: str, folder: str, settings: Mapping[str, Any]):
        description = fmpy.read_model_description(folder, validate=False)
        archive = Archive(Path(path), Path(folder), description)
        self.component = Component(name, archive, ComponentSettings.model_validate(settings))
        inputs, outputs = self.component.inputs, self.component.outputs
        signals = [SignalInfo(f"{EXTERNAL}.{p}", v.unit, v.description, v.shape) for p, v in inputs.items()]
        self._width = sum(info.width for info in signals)
        signals += [SignalInfo(f"{name}.{p}", v.unit, v.description, v.shape) for p, v in outputs.items()]
        first = {f"{name}.{port}": slice(self._width, None) for port in [*outputs][:1]}
        self._wiring = Wiring([name], signals, first, {name: list(range(self._width))})
        self._steppers: dict[float, Stepper] = {}

    def step(self, message: bytes) -> NDArray[np.float64]:
        """Make the step that a message asks for; returns the outputs."""
        time, step_size = struct.unpack_from("=dd", message, 8)
        if step_size not in self._steppers:
            self._steppers[step_size] = Stepper([self.component], self._wiring, step_size)
        stepper = self._steppers[step_size]
        stepper.bus[: self._width] = np.frombuffer(message, offset=_HEAD)
        stepper.advance(round(time / step_size), 1)
        return stepper.bus[self._width :]


def _serve(connection: Connection) -> None:
    """Answer until the other side hangs up; its first call makes the component."""
    server: _Server | None = None
    while True:
        try:
            message = connection.recv_bytes()
        except EOFError:
            break
        answer: dict[str, Any] = {}
        try:
            if server is not None and message[:1] == _STEP:
                logged = len(server.component.messages)
                outputs = server.step(message)
                if len(server.component.messages) == logged:
                    connection.send_bytes(_STEP.ljust(8) + outputs.tobytes())
                    continue
                answer["result"] = outputs.tolist()
            elif server is not None:
                method, arguments = json.loads(message[1:])
                answer["result"] = getattr(server.component, method)(*arguments)
            else:
                server = _Server(*json.loads(message[1:])[1])
        except ComponentError as error:
            answer["error"] = {"time": error.time, "activity": error.activity, "messages": error.messages}
        answer["messages"] = server.component.messages if server is not None else []
        connection.send_bytes(_CALL + json.dumps(answer).encode())
    if server is not None:
        server.component.close()


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group, but is the other process's to handle
    _serve(Connection(int(sys.argv[1])))
