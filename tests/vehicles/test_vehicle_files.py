"""Vehicle files: what is wrong with one is said with file, key and remedy; variants inherit; designs are found."""

import json
import re

import numpy as np
import pytest

from rotordx.fmus.shell import ports
from rotordx.fmus.vehicles import VehicleError, load_design, load_vehicle, vehicle_names
from rotordx.fmus.vehicles.parameters import SensorParameters, VehicleParameters
from rotordx.fmus.vehicles.vehicle import packaged


@pytest.fixture
def lab_x_with(tmp_path):
    """Writes lab_x with one line of it replaced (by nothing: deleted) and returns the path of the file."""

    def write(key, line):
        text, count = re.subn(rf"(?m)^{key} = .*$", line, packaged("lab_x").read_text())
        assert count == 1
        path = tmp_path / "mine.toml"
        path.write_text(text)
        return path

    return write


@pytest.mark.parametrize("name", vehicle_names())
def test_packaged_vehicles_load_and_are_complete(name):
    vehicle = load_vehicle(name)
    assert vehicle.name == name
    expected = {p.name for cls in (VehicleParameters, SensorParameters) for p in ports.table(cls)}
    assert expected <= vehicle.parameters.keys()


@pytest.mark.parametrize("name", vehicle_names())
def test_every_line_of_a_packaged_vehicle_states_unit_and_source(name):
    known = {p.name: p for cls in (VehicleParameters, SensorParameters) for p in ports.table(cls)}
    lines = re.findall(r"(?m)^(\w+) = [^#\n]*# (\S+), .+$", packaged(name).read_text())
    assert {key: unit for key, unit in lines if key in known} == {key: port.unit for key, port in known.items()}


def test_fmus_fly_lab_x_unless_told_otherwise():
    assert ports.flatten(load_vehicle("lab_x").fill(VehicleParameters), lambda *v: np.hstack(v).tolist()) == (
        ports.start_values(VehicleParameters)
    )


def test_what_a_vehicle_does_not_say_keeps_its_start_value(lab_x_with):
    sensors = load_vehicle(lab_x_with("gyro_bias", "")).fill(SensorParameters)
    np.testing.assert_array_equal(sensors.gyro_bias, [0, 0, 0])
    sensors = load_vehicle(lab_x_with("gyro_bias", "gyro_bias = [1, 2, 3]")).fill(SensorParameters)
    np.testing.assert_array_equal(sensors.gyro_bias, [1, 2, 3])


@pytest.mark.parametrize(
    ("key", "line", "message"),
    [
        ("mass", "mas = 1.5", r"`mas` is not a parameter of any FMU \(did you mean `mass`\?\); correct or delete it"),
        ("mass", "wingspan = 1.5", r"`wingspan` is not a parameter of any FMU; correct or delete it"),
        ("mass", "", r"`mass` is missing; add it \(kg: .*\) or name a `base`"),
        ("mass", "mass = 0.0", r"`mass` is 0 but must be positive \(kg: .*\)"),
        ("mass", "mass = -1.5", r"`mass` is -1.5 but must be positive"),
        ("mass", "mass = nan", r"`mass` is nan; give a finite number \(kg\)"),
        ("mass", "mass = 1.5\ndrag_coefficient = 1", r"not valid TOML"),
        ("mass", "mass = '1.5 kg'", r"`mass` must be a number or a list of numbers, not '1.5 kg'"),
        ("mass", "mass = true", r"`mass` must be a number or a list of numbers, not True"),
        ("mass", "mass = [1.5]", r"`mass` is a list of 1; give one number \(kg: .*\)"),
        ("mass", "mass = 1500.0", r"cannot hover: rotor 1 would have to turn at .* rad/s"),
        ("inertia", "inertia = [0.022, 0.024]", r"`inertia` is a list of 2; give a list of 3 numbers \(kg.m2: .*\)"),
        ("inertia", "inertia = 0.022", r"`inertia` is one number; give a list of 3 numbers"),
        ("inertia", "inertia = [0.022, inf, 0.04]", r"`inertia\[2\]` is inf; give a finite number \(kg.m2\)"),
        ("inertia", "inertia = [0.022, 0.024, 0.4]", r"`inertia` belongs to no rigid body.*; check its units"),
        (
            "rotor_direction",
            "rotor_direction = [1, -2, 1, -1]",
            r"`rotor_direction\[2\]` is -2 but must be at least -1",
        ),
        ("rotor_direction", "rotor_direction = [1, 0.5, 1, -1]", r"`rotor_direction` must consist of 1 .* and -1"),
        ("rotor_direction", "rotor_direction = [1, 1, 1, 1]", r"thrust and three torques independently.*; check"),
        ("rotor_x", "rotor_x = [0.2, 0.2, 0.1, 0.1]", r"cannot hover: rotor \d would have to turn at -"),
        ("rotor_speed_min", "rotor_speed_min = 2000", r"`rotor_speed_min` must be below `rotor_speed_max`; correct"),
        ("rotor_speed_min", "rotor_speed_min = 600", r"cannot hover: rotor 1 would have to turn at 553.7 rad/s"),
        ("gravity", "gravity = 9.81\n[more]\nmass = 1", r"`mass` is given in two sections; delete one of them"),
        ("description", "mass = 1.5", r"`mass` is outside a section; put it below a heading such as \[body\]"),
        ("description", "description = 5", r"`description` must be a text; put it in quotes"),
        (
            "description",
            "base = 'lab_y'",
            r"no packaged vehicle `lab_y` \(did you mean `lab_x`\?\); choose one of crazyf",
        ),
        ("description", "base = 'mine.toml'", r"`base` leads back to this file; name a vehicle"),
        ("description", "base = 'other.toml'", r"other.toml: cannot be read: No such file.*; give the path"),
    ],
)
def test_a_mistake_is_named_with_its_remedy(lab_x_with, key, line, message):
    path = lab_x_with(key, line)
    with pytest.raises(VehicleError, match=message) as error:
        load_vehicle(path)
    assert str(path.parent) in str(error.value) or "packaged vehicle" in str(error.value)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("lab", r"there is no packaged vehicle `lab` \(did you mean `lab_x`\?\); choose one of .* or give the path"),
        ("missing/craft.toml", r"missing/craft.toml: cannot be read: No such file or directory; give the path"),
    ],
)
def test_a_vehicle_that_is_not_there(name, message):
    with pytest.raises(VehicleError, match=message):
        load_vehicle(name)


def test_a_file_that_is_no_text(tmp_path):
    path = tmp_path / "noise.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(VehicleError, match=r"noise.toml: is not valid TOML: .*; correct the file"):
        load_vehicle(path)


def test_a_variant_states_only_what_differs(tmp_path):
    (tmp_path / "heavy.toml").write_text('base = "crazyflie"\n[body]\nmass = 0.036\n')
    trim = "[rotors]\nthrust_coefficient = [2.1e-8, 2.3e-8, 2.2e-8, 2.1e-8]\n"
    (tmp_path / "trimmed.toml").write_text(f'description = "trimmed"\nbase = "heavy.toml"\n{trim}')
    base, variant = load_vehicle("crazyflie"), load_vehicle(tmp_path / "trimmed.toml")
    assert (variant.name, variant.description) == ("trimmed", "trimmed")
    assert load_vehicle(tmp_path / "heavy.toml").description == base.description
    changed = {key for key in base.parameters if base.parameters[key] != variant.parameters[key]}
    assert changed == {"mass", "thrust_coefficient"}
    assert variant.parameters["mass"] == 0.036


def test_a_vehicle_may_set_parameters_of_other_fmus(lab_x_with):
    path = lab_x_with("gravity", "gravity = 9.81\n[controller]\nattitude_gain = [6.0, 6.0, 2.0]")
    assert load_vehicle(path).parameters["attitude_gain"] == (6.0, 6.0, 2.0)


def test_a_variant_uses_the_designs_of_its_base_until_it_has_its_own(tmp_path):
    (tmp_path / "base.toml").write_text(packaged("lab_x").read_text())
    (tmp_path / "variant.toml").write_text('base = "base.toml"\n')
    vehicle = load_vehicle(tmp_path / "variant.toml")
    assert load_design(vehicle, "anything") is None
    for owner in ("base", "variant"):
        folder = tmp_path / "designs" / owner
        folder.mkdir(parents=True)
        (folder / "fdie.json").write_text(json.dumps({"vehicle": owner, "parameters": {}}))
        assert load_design(vehicle, "fdie")["vehicle"] == owner
    assert load_design(load_vehicle(tmp_path / "base.toml"), "fdie")["vehicle"] == "base"


@pytest.mark.parametrize(("text", "message"), [("{", "cannot be read as JSON"), ("{}", "has no `parameters`")])
def test_a_damaged_design_is_named(tmp_path, text, message):
    (tmp_path / "mine.toml").write_text('base = "lab_x"\n')
    path = tmp_path / "designs" / "mine" / "fdie.json"
    path.parent.mkdir(parents=True)
    path.write_text(text)
    with pytest.raises(VehicleError, match=rf"fdie.json: {message}.*design it anew"):
        load_design(load_vehicle(tmp_path / "mine.toml"), "fdie")
