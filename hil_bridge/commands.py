"""The commands `hil` and `esc`; what they need is imported when they run, so that --help is quick."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from rotordx.orchestrator.commands import run_command

_BUS = click.option(
    "--bus",
    required=True,
    metavar="URL",
    help="socketcan:vcan0, mcast:0, udp_multicast: or virtual:, also impaired: mcast:0?loss=0.05&delay=0.01&seed=1.",
)
_NODES = (
    click.option("--controller-node", default=10, show_default=True, help="Node id of the flight controller."),
    click.option("--first-esc-node", default=11, show_default=True, help="Node id of the first ESC of four."),
    click.option("--status-rate", default=100.0, show_default=True, metavar="HZ", help="Rate of each ESC's Status."),
)


def _options(*options: Any) -> Any:
    def add(function: Any) -> Any:
        for option in reversed(options):
            function = option(function)
        return function

    return add


@click.command("hil", short_help="Fly a scenario with its rotors on a CAN bus.")
@_BUS
@click.option("--lockstep", is_flag=True, help="Deterministic, as fast as it goes; with emulated ESCs.")
@click.option(
    "--escs",
    type=click.Choice(["own", "running", "real"]),
    default="own",
    show_default=True,
    help="Start an emulator, use one that runs (rotordx esc), or real ESCs.",
)
@_options(*_NODES)
@click.option("--command", type=click.Choice(["raw", "rpm"]), default="raw", show_default=True, help="What ESCs get.")
@click.option(
    "--diagnose-from",
    type=click.Choice(["commanded", "measured"]),
    default="commanded",
    show_default=True,
    help="Rotor speed that diagnosers see.",
)
@click.option("--watchdog", default=0.25, show_default=True, metavar="S", help="Silence of an ESC that ends it.")
@click.option("--fifo", is_flag=True, help="Ask for SCHED_FIFO and locked memory.")
@click.option("--spin-margin", default=200e-6, show_default=True, metavar="S", help="Spinning before a tick.")
@click.option("--bit-rate", default=1e6, show_default=True, metavar="BIT/S", help="Of the bus, for its load.")
@click.option("--i-know-propellers-are-off", is_flag=True, help="Needed for a bus that motors may hang on.")
def hil_command(
    scenario: str,
    diagnosers: tuple[str, ...],
    vehicle: str | None,
    seed: int | None,
    overrides: tuple[str, ...],
    out: Path | None,
    bus: str,
    lockstep: bool,
    escs: str,
    controller_node: int,
    first_esc_node: int,
    status_rate: float,
    command: str,
    diagnose_from: str,
    watchdog: float,
    fifo: bool,
    spin_margin: float,
    bit_rate: float,
    i_know_propellers_are_off: bool,
) -> None:
    """Fly SCENARIO with rotor commands and speeds on a CAN bus (DroneCAN), and write a result folder.

    \b
    Examples:
      rotordx hil avram_circle --bus mcast:0 --lockstep
      rotordx hil rho_adaptive_abrupt -d fdie --bus socketcan:vcan0 --fifo
      rotordx hil hover --bus socketcan:can0 --escs real --i-know-propellers-are-off
    """
    from rotordx.hil_bridge.bridge import fly_over_bus
    from rotordx.hil_bridge.buses import BusAddress
    from rotordx.hil_bridge.emulator import EscSettings
    from rotordx.hil_bridge.protocol import Nodes
    from rotordx.hil_bridge.settings import BridgeSettings
    from rotordx.hil_bridge.timing import sentences
    from rotordx.orchestrator import metrics, results, terminal
    from rotordx.orchestrator.errors import RunError
    from rotordx.orchestrator.scenario import load_scenario

    flown = load_scenario(scenario, overrides, diagnosers=list(diagnosers) or None, vehicle=vehicle, seed=seed)
    settings = BridgeSettings(
        BusAddress.of(bus),
        lockstep=lockstep,
        escs=escs,
        setup=EscSettings(Nodes(controller_node, first_esc_node), status_rate=status_rate),
        command=command,
        fed_speed=diagnose_from,
        watchdog=watchdog,
        fifo=fifo,
        spin_margin=spin_margin,
        bit_rate=bit_rate,
        propellers_are_off=i_know_propellers_are_off,
    )
    folder = out or Path("results") / flown.name
    results.check_folder(folder)
    with terminal.progress(f"{flown.name} on {flown.vehicle} over {settings.bus}", flown.duration_s) as progress:
        flight = fly_over_bus(flown, settings, progress)
    summary = metrics.summarise(flight.recording) | {"hil": flight.figures}
    results.write(flight.recording, summary, folder)
    terminal.show_result(flight.recording, summary, folder)
    for line in sentences(flight.figures):
        click.echo(line)
    if flight.verdict is not None:
        raise RunError(f"the flight {flight.verdict}; what was flown is in {folder}")


# What `run` takes, `hil` takes: the same arguments and options.
hil_command.params[:0] = run_command.params


@click.command("esc", short_help="Emulate ESCs on a CAN bus.")
@_BUS
@click.option("--nodes", default=4, show_default=True, help="Number of ESC nodes, 1 to 4.")
@_options(*_NODES)
@click.option("--stale-after", default=0.25, show_default=True, metavar="S", help="Motors stop without commands.")
@click.option("--scenario", metavar="SCENARIO", help="Whose vehicle and faults are emulated [hover: no fault].")
@click.option("--vehicle", metavar="V", help="Name of a packaged vehicle, or path of a vehicle file.")
@click.option("--set", "overrides", multiple=True, metavar="PATH=VALUE", help="Change a field; repeatable.")
def esc_command(
    bus: str,
    nodes: int,
    controller_node: int,
    first_esc_node: int,
    status_rate: float,
    stale_after: float,
    scenario: str | None,
    vehicle: str | None,
    overrides: tuple[str, ...],
) -> None:
    """Emulate DroneCAN ESCs with the esc FMU until Ctrl-C; faults count from the start of the motors.

    \b
    Examples:
      rotordx esc --bus mcast:0 --nodes 4
      rotordx esc --bus socketcan:vcan0 --scenario avram_circle --set faults[0].onset_s=5
    """
    from rotordx.hil_bridge.buses import BusAddress
    from rotordx.hil_bridge.emulator import EscSettings, emulated
    from rotordx.hil_bridge.protocol import Nodes
    from rotordx.orchestrator.scenario import load_scenario

    flown = load_scenario(scenario or "hover", overrides, vehicle=vehicle)
    settings = EscSettings(Nodes(controller_node, first_esc_node, nodes), stale_after, status_rate)
    address = BusAddress.of(bus)
    with emulated(address, flown, settings) as emulator:
        ids = ", ".join(map(str, settings.nodes.esc_ids))
        click.echo(f"ESC nodes {ids} on {address}, motors of {flown.vehicle}; Ctrl-C ends them", err=True)
        try:
            emulator.run()
        except KeyboardInterrupt:
            click.echo("stopped", err=True)
