"""The tests of `wire` in a network namespace of their own, where multicast reaches nobody else."""

from __future__ import annotations

import os
import subprocess

import pytest
from wire_checks import WIRE, pytest_on

#: a loopback interface that carries multicast, for IPv4; nothing leads out
NETWORK = 'ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && exec "$@"'
BUSES = ("mcast:0", "udp_multicast:")


def in_private_network(*command: str) -> list[str]:
    """Root keeps its rights to SCHED_FIFO; others need a user namespace, in which there is none."""
    user = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    return ["unshare", *user, "--net", "sh", "-c", NETWORK, "sh", *command]


@pytest.fixture(scope="session")
def private_network() -> None:
    """Skips where the machine gives nobody a network namespace (no `unshare` or `ip`, or a container that forbids it).

    On the machine's own network the multicast frames of these tests would meet those of other programs.
    """
    try:
        attempt = subprocess.run(in_private_network("true"), capture_output=True, text=True)
    except FileNotFoundError as error:
        pytest.skip(f"no private network, unshare or ip is not installed: {error}")
    if attempt.returncode:
        pytest.skip(f"no private network, this machine forbids it: {attempt.stderr.strip()}")


@pytest.mark.xdist_group("wire")
@pytest.mark.parametrize("checks", sorted(WIRE.glob("check_*.py")), ids=lambda path: path.stem)
def test_in_a_private_network(private_network, checks):
    result = subprocess.run(
        in_private_network(*pytest_on(BUSES, checks)),
        cwd=WIRE.parents[2],
        capture_output=True,
        text=True,
        timeout=400,
    )
    assert result.returncode == 0, result.stdout + result.stderr
