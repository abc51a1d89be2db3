"""An FMU instance in a process of its own, which may crash or hang without taking the run with it.

The two processes talk over a pair of sockets. A step is one message each way, of inputs and outputs as float64;
everything else, and the answer to a step in which the FMU has logged something, is JSON. The other process leads a
session of its own: what the FMU starts ends with it, and it ends when nobody listens any more.
"""

from __future__ import annotations

import json
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
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
from rotordx.orchestrator.variables import ACCESS, Element, Variable
from rotordx.orchestrator.wiring import EXTERNAL, Wiring

TIMEOUT_S = 10.0  #: of a call, if the component's settings do not state one
START_UP_S = 60.0  #: a process may take this long to start, before the FMU comes in
FREE_S = 1.0  #: an FMU may take this long to free itself
MEMORY_MIB = 4096  #: of an isolated FMU, if the component's settings do not state it

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
        self._stepping = False
        self._birth = [self.name, str(archive.path), str(archive.folder), settings.model_dump(exclude_unset=True)]
        self._start()
        self.fmi, self.substeps = 3, 1  # of the functions that the stepper calls
        self.variables = {v.name: _plain(v, i) for i, v in enumerate(self.variables.values())}
        self._inputs = np.zeros(sum(v.size for v in self.inputs.values()))
        self._outputs = np.zeros(sum(v.size for v in self.outputs.values()))
        self._functions = {
            "SetFloat64": _Exchange(self._keep_inputs),
            "DoStep": _DoStep(self._do_step),
            "GetFloat64": _Exchange(self._give_outputs),
        }

    def _start(self) -> None:
        """Start the other process and let it make its instance."""
        self._owner = os.getpid()
        self._socket, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-m", __name__, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                pass_fds=[theirs.fileno()],
                start_new_session=True,
            )
        self._connection = Connection(os.dup(self._socket.fileno()))
        try:
            self._limit_waiting(START_UP_S)
            self._call("starting its process", "start")
            self._limit_waiting(self._timeout)
            self._call("instantiation", "make", *self._birth)
        except BaseException:
            self.close()
            raise

    @property
    def instance(self) -> c_void_p:
        """None: our functions know what they belong to."""
        return c_void_p()

    def function(self, name: str) -> c_void_p:
        """Address of a function that passes the call on."""
        return cast(self._functions[name], c_void_p)

    def reset(self) -> None:
        """Back to the state after instantiation; a fork of the process that started the FMU starts one of its own."""
        self.messages.clear()
        self._stepping = False
        if self._owner == os.getpid() and self._process.poll() is None:
            self._call("reset", "reset")
        else:
            self.close()
            self._start()

    def set_parameters(self, values: Mapping[str, Sequence[Any]]) -> None:
        """Set the elements of parameters by name, between a reset and the initialisation."""
        self._call("setting parameters", "set_parameters", {name: list(elements) for name, elements in values.items()})

    def enter_initialization(self) -> None:
        """Enter initialisation mode, at t = 0."""
        self._outputs[:] = self._call("entering initialisation mode", "enter_initialization")

    def exit_initialization(self) -> None:
        """Leave initialisation mode, ready to step."""
        self._outputs[:] = self._call("initialisation", "exit_initialization")
        self._stepping = True

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
        """End the other process, which frees the FMU if it can, and all that the FMU has started."""
        self._connection.close()
        self._socket.close()
        if self._owner != os.getpid():
            return
        try:
            with suppress(subprocess.TimeoutExpired):
                self._process.wait(FREE_S)
        finally:
            self._kill()

    def _kill(self) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def _limit_waiting(self, seconds: float) -> None:
        self._limit = seconds
        limit = struct.pack("@ll", int(seconds), int(seconds % 1 * 1e6))
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, limit)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, limit)

    def _keep_inputs(self, _: int, references: int, count: int, values: int, size: int) -> int:
        memmove(self._inputs.ctypes.data, values, 8 * size)
        return 0 if self._stepping else self._contained(self._initialise)

    def _give_outputs(self, _: int, references: int, count: int, values: int, size: int) -> int:
        memmove(values, self._outputs.ctypes.data, 8 * size)
        return 0

    def _do_step(self, _: int, time: float, step_size: float, *__: Any) -> int:
        return self._contained(self._step, time, step_size)

    def _contained(self, action: Callable[..., None], *arguments: float) -> int:
        """Status of an action that C has called, where an exception would get lost: `failure` raises it."""
        try:
            action(*arguments)
        except BaseException as error:
            self._error = error
            return FATAL
        return 0

    def _initialise(self) -> None:
        self._outputs[:] = self._call("setting inputs", "set_inputs", self._inputs.tolist())

    def _step(self, time: float, step_size: float) -> None:
        head = _STEP.ljust(8) + struct.pack("=dd", time, step_size)
        reply = self._exchange("doStep", time, head + self._inputs.tobytes())
        self._outputs[:] = np.frombuffer(reply, offset=8) if reply[:1] == _STEP else self._answer(reply)

    def _call(self, activity: str, method: str, *arguments: Any) -> Any:
        """Call a method of the server in the other process."""
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
        return answer["result"]

    def _exchange(self, activity: str, time: float, message: bytes) -> bytes:
        """Send a message and wait for its reply.

        Raises:
            ComponentError: the other process has crashed or does not answer in time.
        """
        try:
            self._connection.send_bytes(message)
            return self._connection.recv_bytes()
        except (EOFError, OSError) as error:
            what = self._end_of_process(silent=isinstance(error, BlockingIOError))
        except BaseException:
            self._kill()  # its answer must not be taken for the next one
            raise
        raise ComponentError(self.name, time, activity, [*self.messages, what])

    def _end_of_process(self, silent: bool) -> str:
        """What became of a process that has hung up, or is silent; now it and all that it has started are gone."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(0 if silent else FREE_S)
        code = self._process.returncode
        self._kill()
        if code is not None and code < 0:
            return f"it crashed: {signal.strsignal(-code)}"
        if code is not None:
            return f"it ended with exit code {code}"
        return f"it did not answer within {self._limit:g} s and was stopped (timeout_s)" if silent else "it hung up"


def _plain(variable: Variable, reference: int) -> Variable:
    """The variable as the other process gives it: a double, converted, and behind a value reference of its own."""
    if not variable.is_number or variable.causality not in ("input", "output"):
        return variable
    elements = tuple(Element(reference, i, variable.size) for i in range(variable.size))
    return replace(variable, type="Float64", access=ACCESS[3]["Float64"], elements=elements)


class _Server:
    """The other process: one component, and a stepper that is fed from outside."""

    def __init__(self, name: str, path: str, folder: str, settings: Mapping[str, Any]):
        own = ComponentSettings.model_validate(settings)
        _limit_memory(own.memory_mib or MEMORY_MIB)
        description = fmpy.read_model_description(folder, validate=False)
        archive = Archive(Path(path), Path(folder), description)
        self.component = Component(name, archive, own)
        inputs, outputs = self.component.inputs, self.component.outputs
        signals = [SignalInfo(f"{EXTERNAL}.{p}", v.unit, v.description, v.shape) for p, v in inputs.items()]
        self._width = sum(info.width for info in signals)
        signals += [SignalInfo(f"{name}.{p}", v.unit, v.description, v.shape) for p, v in outputs.items()]
        first = {f"{name}.{port}": slice(self._width, None) for port in [*outputs][:1]}
        self._wiring = Wiring([name], signals, first, {name: list(range(self._width))})
        self._stepper = Stepper([self.component], self._wiring, 0.0)  # the first step says how long it is

    def call(self, method: str, arguments: Sequence[Any]) -> list[float] | None:
        """Call one of the component's methods; returns the outputs if they are defined then."""
        if method == "set_inputs":
            self._stepper.bus[: self._width] = arguments[0]
            self._stepper.set_inputs(0)
        else:
            getattr(self.component, method)(*arguments)
        if method in ("reset", "set_parameters"):
            return None
        self._stepper.get_outputs(0)
        outputs: list[float] = self._stepper.bus[self._width :].tolist()
        return outputs

    def step(self, message: bytes) -> NDArray[np.float64]:
        """Make the step that a message asks for; returns the outputs."""
        time, step_size = struct.unpack_from("=dd", message, 8)
        if step_size != self._stepper.step_size:
            self._stepper = Stepper([self.component], self._wiring, step_size)
        self._stepper.bus[: self._width] = np.frombuffer(message, offset=_HEAD)
        self._stepper.advance(round(time / step_size), 1)
        return self._stepper.bus[self._width :]


def _serve(connection: Connection) -> None:
    """Answer until the other side hangs up."""
    server: _Server | None = None
    try:
        while True:
            message, answer = connection.recv_bytes(), dict[str, Any](result=None)
            try:
                if server is not None and message[:1] == _STEP:
                    logged = len(server.component.messages)
                    outputs = server.step(message)
                    if len(server.component.messages) == logged:
                        connection.send_bytes(_STEP.ljust(8) + outputs.tobytes())
                        continue
                    answer["result"] = outputs.tolist()
                else:
                    method, arguments = json.loads(message[1:])
                    if method == "make":
                        server = _Server(*arguments)
                    elif server is not None:
                        answer["result"] = server.call(method, arguments)
            except ComponentError as error:
                answer["error"] = {"time": error.time, "activity": error.activity, "messages": error.messages}
            answer["messages"] = server.component.messages if server is not None else []
            connection.send_bytes(_CALL + json.dumps(answer).encode())
    except (EOFError, OSError):
        if server is not None:
            server.component.close()


def _end_when_nobody_listens(descriptor: int) -> None:
    """A thread that ends this process, also if the FMU hangs, once the other side has hung up."""
    listening = select.poll()
    listening.register(descriptor, 0)
    listening.poll()
    time.sleep(FREE_S)
    os.killpg(0, signal.SIGKILL)


def _limit_memory(mebibytes: int) -> None:
    """Refuse memory beyond a limit to this process, so that an FMU cannot take what the machine has."""
    import resource  # which not every system has

    resource.setrlimit(resource.RLIMIT_DATA, (mebibytes * 2**20,) * 2)


def _main(descriptor: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the other process's to handle
    os.dup2(2, 1)  # what an FMU prints does not belong among the results on stdout
    threading.Thread(target=_end_when_nobody_listens, args=[descriptor], daemon=True).start()
    _serve(Connection(descriptor))
    os.killpg(0, signal.SIGKILL)  # and all that the FMU has started


if __name__ == "__main__":
    _main(int(sys.argv[1]))
