"""What is on the bus and how it is flown, and what of that is impossible."""

from __future__ import annotations

from dataclasses import dataclass, field

from rotordx.hil_bridge.buses import BusAddress
from rotordx.hil_bridge.emulator import EscSettings
from rotordx.hil_bridge.load import RAW, Plan, plan
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.scenario import Scenario

OWN, RUNNING, REAL = "own", "running", "real"  #: emulated by us, by a process that runs already; real ESCs
COMMANDED, MEASURED = "commanded", "measured"  #: the rotor speed that diagnosers are fed


@dataclass(frozen=True)
class BridgeSettings:
    """What is on the bus and how it is flown."""

    bus: BusAddress
    lockstep: bool = False
    escs: str = OWN
    setup: EscSettings = field(default_factory=EscSettings)
    command: str = RAW
    fed_speed: str = COMMANDED
    watchdog: float = 0.25  #: s of silence of an ESC after which the flight ends
    fifo: bool = False  #: ask for SCHED_FIFO and locked memory
    spin_margin: float = 200e-6  #: s
    bit_rate: float = 1e6  #: bit/s of the bus, for its load
    propellers_are_off: bool = False

    def __post_init__(self) -> None:
        if self.bus.is_real and not self.propellers_are_off:
            raise UserError(
                f"--bus {self.bus}: motors may hang on this bus and will turn: take the propellers off and say so with "
                "--i-know-propellers-are-off"
            )
        if self.lockstep and self.escs == REAL:
            raise UserError("real ESCs do not wait: --lockstep needs emulated ones")
        if self.bus.is_in_process and self.escs != OWN:
            raise UserError(f"--bus {self.bus}: no other process can reach this bus, fly it with --escs own")
        if not self.watchdog > 0:
            raise UserError(f"--watchdog must be positive, not {self.watchdog:g}")

    def plan(self, scenario: Scenario) -> Plan:
        """What will be on the bus."""
        setup = self.setup
        return plan(
            scenario.step_size_s,
            setup.status_rate,
            setup.nodes.escs,
            command=self.command,
            emulated=self.escs != REAL,
            bit_rate=self.bit_rate,
        )
