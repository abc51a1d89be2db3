"""From excluded rotors to a named one (isolation decision scheme of Avram, Zhang, Khalili, section 3.2)."""

from __future__ import annotations

from math import nan

from casadi import if_else, logic_and, repmat, sum1, vertcat

from rotordx.fmus.diagnosers.interface import ROTORS, Clock, capture_time
from rotordx.fmus.shell.ports import Scalar, Vector, port, ports

#: The rules, in the order in which their decisions lie in memory.
RULES = ("paper", "set_membership")


@ports
class NamingParameters:
    """Which rule names the rotor, and when."""

    isolation_rule: Scalar = port("1", "feeds faulty_rotor, isolation_time and loe_estimate", start=1, choices=RULES)
    dwell_time: Scalar = port(
        "s", "set membership names a rotor that has been the only one left for so long", start=0.02, minimum=0
    )


@ports
class NamingState:
    """Decisions of the two rules: paper, set membership."""

    alone_since: Vector = port("s", "time at which at most one rotor was left, NaN before", start=(nan,) * 2)
    named: Vector = port("1", "1..4, -1 no loss of a single rotor, 0 not yet (latched)", start=(0,) * 2)
    naming_time: Vector = port("s", "time at which a rotor was named, NaN before", start=(nan,) * 2)


def advance_naming(
    state: NamingState, excluded_before: Vector, excluded: Vector, parameters: NamingParameters, clock: Clock
) -> NamingState:
    """Name the rotor that alone is left, or none if none is left.

    Args:
        excluded_before, excluded: latched flags before and after this step, rows are rotors, columns the rules.
    """
    left = 4 - sum1(excluded).T
    time = repmat(clock.time, 2, 1)
    alone_since = capture_time(state.alone_since, 4 - sum1(excluded_before).T <= 1, left <= 1, time)
    dwell_time = vertcat(0, parameters.dwell_time)
    long_enough = time - alone_since > dwell_time - clock.dt / 2
    verdict = if_else(left == 0, -1, if_else(logic_and(left == 1, long_enough), (1 - excluded).T @ ROTORS, 0))
    named = if_else(state.named == 0, verdict, state.named)
    return NamingState(alone_since, named, capture_time(state.naming_time, state.named > 0, named > 0, time))
