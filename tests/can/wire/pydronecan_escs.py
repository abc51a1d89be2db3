"""Four ESCs made of pydronecan nodes: `python pydronecan_escs.py BUS`; first-order motors, Status at 50 Hz."""

from __future__ import annotations

import contextlib
import math
import sys
import time

import dronecan

esc = dronecan.uavcan.equipment.esc
FULL_SCALE, LARGEST, LAG, PERIOD = 8191, 950.0, 0.03, 0.02


class Motor:
    def __init__(self, bus: str, index: int):
        self.node = dronecan.make_node(bus, node_id=11 + index, bitrate=1_000_000)
        self.node.mode = dronecan.uavcan.protocol.NodeStatus().MODE_OPERATIONAL
        self.index, self.target, self.speed, self.armed, self.updated = index, 0.0, 0.0, False, time.monotonic()
        self.node.add_handler(esc.RawCommand, self.on_command)
        self.node.add_handler(dronecan.uavcan.equipment.safety.ArmingStatus, self.on_arming)
        self.node.periodic(PERIOD, self.report)

    def on_command(self, event) -> None:
        self.target = max(0, event.message.cmd[self.index]) / FULL_SCALE * LARGEST

    def on_arming(self, event) -> None:
        self.armed = event.message.status == 255

    def report(self) -> None:
        now = time.monotonic()
        target = self.target if self.armed else 0.0
        self.speed = target + math.exp(-(now - self.updated) / LAG) * (self.speed - target)
        self.updated = now
        self.node.broadcast(
            esc.Status(
                error_count=0, voltage=12.0, current=1.0, temperature=300.0, rpm=round(self.speed * 30 / math.pi),
                power_rating_pct=10, esc_index=self.index,
            )
        )  # fmt: skip


motors = [Motor(sys.argv[1], i) for i in range(4)]
print("ready", flush=True)
while True:
    for motor in motors:
        with contextlib.suppress(dronecan.UAVCANException):  # types of others
            motor.node.spin(0)
    time.sleep(0.001)
