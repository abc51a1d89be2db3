"""The tests of `wire` on real SocketCAN: a vcan inside user-mode Linux (`make vcan`)."""

from __future__ import annotations

import pytest
from user_mode_linux import run
from wire_checks import pytest_on

#: that Linux is too slow for 500 Hz by the clock
PACED = ("real_time", "bridge_killed", "end_of_a_flight")


@pytest.mark.slow
def test_on_a_real_vcan():
    try:
        result = run(
            [*pytest_on(["socketcan:vcan0"]), "-k", " and ".join(f"not {name}" for name in PACED)], timeout=900
        )
    except FileNotFoundError as error:
        pytest.skip(str(error))
    assert result.returncode == 0, result.stdout
