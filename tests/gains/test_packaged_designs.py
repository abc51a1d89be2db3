"""Packaged designs: every certificate holds in exact arithmetic, and a design that is out of date is found out."""

import time

import pytest

from rotordx.fmus.vehicles import load_vehicle, vehicle_names
from rotordx.gains import flight_model, verify
from rotordx.gains.commands import designable
from rotordx.gains.packaged import make, packaged_designs, same

CERTIFIED = [(vehicle, diagnoser) for vehicle in vehicle_names() for diagnoser in designable()]


def test_every_packaged_vehicle_has_every_design():
    missing = [pair for pair in CERTIFIED if not (packaged_designs() / pair[0] / f"{pair[1]}.json").is_file()]
    assert not missing, "run `make designs`"
    assert {"lab_x", "f450_plus", "ren_plus", "crazyflie"} <= set(vehicle_names())


def test_every_packaged_design_is_proved(record_property):
    start = time.perf_counter()
    for path in sorted(packaged_designs().glob("*/*.json")):
        refused = [check for check in verify.verify(path) if not check.passed]
        assert not refused, f"{path.parent.name}/{path.name}: {refused}; run `make designs`"
    record_property("seconds", round(time.perf_counter() - start, 1))
    print(f"all packaged certificates proved in {time.perf_counter() - start:.1f} s")


@pytest.mark.parametrize(
    "diagnoser", ["thau", "adaptive_thau", "fast_adaptive", "smo", "rho_adaptive", "askf", "msjfo"]
)
def test_a_packaged_design_is_what_the_tool_makes(diagnoser):
    assert same(make("lab_x", diagnoser), packaged_designs() / "lab_x" / f"{diagnoser}.json"), "run `make designs`"


@pytest.mark.parametrize("parameter", ["inertia", "thrust_coefficient", "gyro_noise_std"])
def test_a_changed_vehicle_makes_its_designs_stale(parameter, monkeypatch):
    craft = load_vehicle("lab_x")
    value = craft.parameters[parameter]
    craft.parameters[parameter] = tuple(1.1 * v for v in value) if isinstance(value, tuple) else 1.1 * value
    monkeypatch.setattr(verify, "load_vehicle", lambda name: craft)
    for diagnoser in ("hinf", "thau", "askf"):
        refused = [c for c in verify.verify(packaged_designs() / "lab_x" / f"{diagnoser}.json") if not c.passed]
        assert [c.what for c in refused] == ["vehicle"]
        assert refused[0].detail == f"{parameter} changed since the design; design it anew"


def test_changed_model_terms_make_all_designs_stale(monkeypatch):
    rate_dynamics = flight_model.terms.rate_dynamics
    monkeypatch.setattr(flight_model.terms, "rate_dynamics", lambda *arguments: 2 * rate_dynamics(*arguments))
    flight_model._functions.cache_clear()
    try:
        refused = {c.what: c.detail for c in verify.verify(packaged_designs() / "lab_x" / "hinf.json") if not c.passed}
    finally:
        flight_model._functions.cache_clear()
    assert refused["model terms"] == "they changed since the design was made; design it anew"


def test_more_inertia_gives_other_gains_and_another_hash():
    from rotordx.gains import hinf
    from rotordx.gains.options import with_settings

    craft = load_vehicle("ren_plus")
    options = with_settings(hinf.Options(), ['models=["tau3"]'])
    before = hinf.design(craft, options)
    craft.parameters["inertia"] = tuple(1.1 * v for v in craft.parameters["inertia"])
    after = hinf.design(craft, options)
    assert before.vehicle_hash != after.vehicle_hash
    assert abs(before.parameters["torque_observer_gain"] - after.parameters["torque_observer_gain"]).max() > 0.01
