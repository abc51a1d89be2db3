"""A flight without noise for `hinf`: the vehicle stays in hover, each command makes up for what its rotor has lost."""

import numpy as np

from rotordx.fmus.vehicles import load_vehicle
from rotordx.gains.flight_model import flight_model
from tests.thau.driver import run

DT = 0.004
ONSET = 1.5
#: a healthy window that is over at the onset
SHORT = {"warm_up_time": 0.5, "calibration_time": 0.5}


def hold(*losses, vehicle="lab_x", duration=3.5, **parameters):
    """Outputs by port over time, under losses (4,) each of which comes half a second after the one before."""
    time = DT * np.arange(1, round(duration / DT) + 1)
    effective = np.ones((len(time), 4))
    for i, loss in enumerate(losses):
        effective[time > ONSET + i / 2] *= 1 - np.asarray(loss, dtype=float)
    inputs = np.zeros((len(time), 11))
    inputs[:, :4] = flight_model(load_vehicle(vehicle)).hover_speed / np.sqrt(effective)
    return run("hinf", time, inputs, vehicle, **SHORT, **parameters)
