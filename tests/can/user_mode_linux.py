"""Runs a command where SocketCAN is real: in user-mode Linux, a kernel that is a program, with a vcan and a vxcan pair.

`python user_mode_linux.py COMMAND...` boots Debian's package user-mode-linux with this machine's files, read-only, and
this folder as the working one; the exit code is the command's. Nothing there can reach this machine's network.
"""

from __future__ import annotations

import ctypes
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

KERNEL = "linux.uml"
MODULES = (
    "net/can/can",
    "drivers/net/can/dev/can-dev",
    "net/can/can-raw",
    "net/can/can-gw",
    "drivers/net/can/vcan",
    "drivers/net/can/vxcan",
    "net/sched/sch_netem",
)
MEMORY = "1500M"
FINIT_MODULE = 313  #: system call of x86-64, the only machine that the package is for
POWER_OFF = 0x4321FEDC
RESULT = "exit code of the command:"


def run(command: list[str], timeout: float) -> subprocess.CompletedProcess[str]:
    """Run a command in user-mode Linux; what it prints is in `stdout`, with what the kernel says.

    Raises:
        FileNotFoundError: the package is not installed.
        subprocess.TimeoutExpired: it took longer (s).
    """
    kernel = shutil.which(KERNEL)
    if kernel is None:
        raise FileNotFoundError(f"{KERNEL} is not installed (Debian package user-mode-linux)")
    with tempfile.TemporaryDirectory() as folder:
        init = Path(folder) / "init"
        init.write_text(_init_script(command, Path(kernel).resolve().parents[1]))
        init.chmod(0o755)
        arguments = [f"mem={MEMORY}", "root=/dev/root", "rootfstype=hostfs", "rootflags=/", "ro", "quiet", "loglevel=3"]
        process = subprocess.Popen(
            [kernel, *arguments, f"init={init}", "con=null", "con0=null,fd:1", "ssl=null"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            output, _ = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)
            output, _ = process.communicate()
            raise subprocess.TimeoutExpired(command, timeout, output) from None
    code = output.rpartition(RESULT)[2].split()
    return subprocess.CompletedProcess(command, int(code[0]) if RESULT in output else 1, output)


def _init_script(command: list[str], prefix: Path) -> str:
    """The first program of that Linux: file systems, modules, buses, command, power off."""
    itself = shlex.join([sys.executable, str(Path(__file__).resolve())])
    needed = [Path.cwd().resolve(), *(Path(p).resolve() for p in (sys.executable, sys.prefix, sys.base_prefix))]
    writable = [f for f in ("/run", "/tmp", "/var/tmp") if not any(n.is_relative_to(f) for n in needed)]
    return f"""#!/bin/sh
export PATH={shlex.quote(os.environ["PATH"])} HOME=/ LANG=C.UTF-8 TMPDIR=/dev/shm
export PYTHONDONTWRITEBYTECODE=1 HYPOTHESIS_STORAGE_DIRECTORY=/dev/shm
{itself} --load-modules {shlex.quote(str(prefix))}
mount -t proc proc /proc; mount -t sysfs sys /sys; mount -t devtmpfs dev /dev
mkdir -p /dev/shm
for folder in {shlex.join(["/dev/shm", *writable])}; do mount -t tmpfs tmpfs $folder; done
ip link set lo up
ip link add dev vcan0 type vcan && ip link set vcan0 up
ip link add vxcan0 type vxcan peer name vxcan1 && ip link set vxcan0 up && ip link set vxcan1 up
cd {shlex.quote(os.getcwd())} && {shlex.join(command)}
echo "{RESULT} $?"
{itself} --power-off
"""


def _load_modules(prefix: Path) -> None:
    folder = next(prefix.glob("lib/uml/modules/*/kernel"))
    libc = ctypes.CDLL(None, use_errno=True)
    for module in MODULES:
        file = os.open(folder / f"{module}.ko", os.O_RDONLY)
        if libc.syscall(FINIT_MODULE, file, b"", 0):
            print(module, os.strerror(ctypes.get_errno()))
        os.close(file)


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["--load-modules", prefix]:
            _load_modules(Path(prefix))
        case ["--power-off"]:
            ctypes.CDLL(None).reboot(POWER_OFF)
        case command:
            finished = run(command, timeout=600)
            print(finished.stdout)
            sys.exit(finished.returncode)
