"""A signal mapping is checked as a whole, and refused by file and field with what is allowed."""

from __future__ import annotations

import pytest

from rotordx.orchestrator.documents import packaged_names
from rotordx.orchestrator.errors import UserError
from rotordx.orchestrator.signal_map import load_signal_map, matching_signal_map


@pytest.mark.parametrize("name", ["crazypad", "recording"])
def test_packaged_mappings_are_valid(name):
    assert name in packaged_names("signal_maps")
    assert load_signal_map(name).name == name


def test_a_mapping_is_read_from_a_path(write_map, mapping):
    signal_map = load_signal_map(write_map(mapping))
    assert signal_map.name == "foreign"
    assert signal_map.body_rate.sign == [1, -1, -1]
    assert signal_map.column_names[:3] == ("t_ms", "m1", "m2")


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ("time.unit", "minutes", "time.unit is 'minutes' but must be s, ms, us or ns"),
        ("time.column", None, "time.column is missing, it must be the name of a column"),
        ("body_rate.columns", ["gx", "gy"], "body_rate.columns is ['gx', 'gy'] but must be a list of three columns"),
        ("body_rate.sign", [1, -1, 2], "body_rate.sign[2] is 2 but must be a list of three signs, 1 or -1"),
        ("body_rate.unit", "rpm", "body_rate.unit is 'rpm' but must be rad/s, mrad/s or deg/s"),
        ("body_rate.signs", [1, 1, 1], "body_rate.signs is not a known field, it must be one of"),
        ("euler.source", "guess", "euler.source is 'guess' but must be columns, level or integrated_body_rate"),
        ("euler.source", None, "euler.source is missing, it must be columns, level or integrated_body_rate"),
        ("euler.source", "level", 'euler: source = "level" has no use for `columns`'),
        ("euler.unit", None, 'euler: source = "columns" needs `unit`'),
        ("euler.delay_s", 5.0, "euler.delay_s is 5.0 but must be a time in seconds, -1 to 1"),
        ("vertical_velocity.velocity", None, "vertical_velocity: give it a table `velocity` or a table `altitude`"),
        ("vertical_velocity.crossover_rad_s", 2.0, "vertical_velocity: `specific_force` and `crossover_rad_s` are"),
        ("rotor_speed_command.columns", ["m1"], "rotor_speed_command: `columns` names 1; name one for each rotor, 4"),
        ("rotor_speed_command.mixer", [[1.0]] * 4, "every row of `mixer` needs one factor for each of the 4"),
        ("rotor_speed_command.clip", [1.0, 0.0], "`clip` must be [lowest, highest]"),
        ("rotor_speed_command.unit", None, 'rotor_speed_command: kind = "rotor_speed" needs `unit`'),
        ("rotor_speed_command.full_scale", 1.0, 'kind = "rotor_speed" has no use for `full_scale`'),
        ("rotor_speed_command.kind", "thrust_proportional", 'kind = "thrust_proportional" needs `full_scale`'),
        ("samples.longest_gap_s", 0, "samples.longest_gap_s is 0 but must be a time in seconds, above 0"),
        ("airborne.above", 1.0, "airborne.column is missing"),
    ],
)
def test_impossible_fields_are_refused_by_name(write_map, mapping, path, value, message):
    table, field = path.split(".")
    if value is None:
        del mapping[table][field]
    else:
        mapping.setdefault(table, {})[field] = value
    file = write_map(mapping)
    with pytest.raises(UserError) as refused:
        load_signal_map(file)
    assert str(refused.value).startswith(f"{file}: ")
    assert message in str(refused.value)


def test_a_missing_table_is_named(write_map, mapping):
    del mapping["body_rate"]
    with pytest.raises(UserError, match=r"foreign\.toml: body_rate is missing"):
        load_signal_map(write_map(mapping))


def test_unreadable_files_are_refused_by_name(tmp_path):
    broken = tmp_path / "broken.toml"
    broken.write_text("[time\n")
    with pytest.raises(UserError, match=r"broken\.toml is not valid TOML"):
        load_signal_map(broken)
    with pytest.raises(UserError, match=r"absent\.toml cannot be read: No such file"):
        load_signal_map(tmp_path / "absent.toml")
    with pytest.raises(UserError, match=r"'crazy' must be one of crazypad, recording \(did you mean crazypad"):
        load_signal_map("crazy")


def test_the_packaged_mapping_that_fits_a_log_is_found():
    columns = list(load_signal_map("crazypad").column_names)
    assert matching_signal_map([*columns, "another"], "a.csv").name == "crazypad"
    with pytest.raises(
        UserError, match=r"a\.csv: no packaged signal mapping fits, crazypad for lack of .* gyro_x_rad_s;"
    ):
        matching_signal_map([name for name in columns if name != "gyro_x_rad_s"], "a.csv")
    both = [*columns, *load_signal_map("recording").column_names]
    with pytest.raises(UserError, match=r"a\.csv: the signal mappings crazypad and recording fit; say with --signals"):
        matching_signal_map(both, "a.csv")
