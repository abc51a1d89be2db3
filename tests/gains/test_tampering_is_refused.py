"""Tampered certificates: each is refused with its reason, also when the digest is made to fit again."""

import json

import pytest

from rotordx.gains.design import plain_hash
from rotordx.gains.options import DesignError
from rotordx.gains.verify import checks, verify


def write(document, tmp_path, sign):
    if sign:
        content = {key: value for key, value in document.items() if key != "digest"}
        document = content | {"digest": plain_hash(content)}
    folder = tmp_path / "designs" / document["vehicle"]
    folder.mkdir(parents=True)
    path = folder / f"{document['diagnoser']}.json"
    path.write_text(json.dumps(document), encoding="utf-8")
    return path


def refused(path):
    return {check.what: check.detail for check in verify(path) if not check.passed}


def one_digit_in_a_gain(document):
    gain = document["parameters"]["observer_gain"]
    largest = max(range(len(gain)), key=lambda i: abs(gain[i]))
    gain[largest] *= 1.1


def gamma(document):
    document["certificates"][0]["proof"]["gamma"] *= 0.95


def lipschitz(document):
    document["certificates"][0]["model"]["lipschitz"] *= 5


def input_matrix(document):
    for A in document["certificates"][0]["model"]["A"]:
        for row in A:
            row[-4:] = [0.9 * v for v in row[-4:]]


def decay_rate(document):
    document["certificates"][0]["proof"]["decay_rate"] *= 4


def disk_radius(document):
    document["certificates"][0]["proof"]["disk_radius"] *= 0.8


def lyapunov_matrix(document):
    P = document["certificates"][0]["proof"]["P"]
    P[0][0] *= -1


TAMPERINGS = {
    one_digit_in_a_gain: ("vz4: figures", "do not follow from the gains"),
    gamma: ("vz4: bounded real, corner 1", "violated"),
    lipschitz: ("vz4: bounded real, corner 1", "violated"),
    input_matrix: ("vz4: model", "A differ from what follows from the vehicle"),
    decay_rate: ("vz4: bounded real, corner 1", "violated"),
    disk_radius: ("vz4: disk, corner 1", "violated"),
    lyapunov_matrix: ("vz4: Lyapunov matrix", "violated"),
}


@pytest.mark.parametrize("tamper", TAMPERINGS)
def test_a_change_after_writing_is_seen_by_its_digest(packaged, tmp_path, tamper):
    document = packaged("lab_x", "hinf")
    tamper(document)
    assert refused(write(document, tmp_path, sign=False))["digest"] == "the file was changed after it was written"


@pytest.mark.parametrize("tamper", TAMPERINGS)
def test_a_false_claim_is_refused_even_with_a_fitting_digest(packaged, tmp_path, tamper):
    document = packaged("lab_x", "hinf")
    tamper(document)
    found = refused(write(document, tmp_path, sign=True))
    what, reason = TAMPERINGS[tamper]
    assert "digest" not in found
    assert reason in found[what]


@pytest.mark.parametrize("row", ["roll", "p", "v_z", "fault_1"])
def test_a_percent_of_any_row_of_the_gain_shows_in_the_figures(packaged, tmp_path, row):
    document = packaged("lab_x", "hinf")
    model = document["certificates"][0]["model"]
    width, gain = len(model["outputs"]), document["parameters"]["observer_gain"]
    first = model["states"].index(row) * width
    largest = max(range(first, first + width), key=lambda i: abs(gain[i]))
    gain[largest] *= 1.01
    assert "vz4: figures" in refused(write(document, tmp_path, sign=True))


@pytest.mark.parametrize("hashed", ["vehicle", "model_terms"])
def test_a_stale_hash_is_refused(packaged, tmp_path, hashed):
    document = packaged("lab_x", "rho_adaptive")
    document["hashes"][hashed] = "0" * 64
    found = refused(write(document, tmp_path, sign=True))
    assert list(found) == [{"vehicle": "vehicle hash", "model_terms": "model terms"}[hashed]]


def test_other_vehicle_parameters_are_refused_by_name(packaged, tmp_path):
    document = packaged("lab_x", "rho_adaptive")
    document["vehicle_parameters"]["mass"] = 1.6
    document["hashes"]["vehicle"] = plain_hash(document["vehicle_parameters"])
    found = refused(write(document, tmp_path, sign=True))
    assert found["vehicle"] == "mass changed since the design; design it anew"


def test_a_weight_of_the_detection_bound_cannot_be_understated(packaged, tmp_path):
    document = packaged("lab_x", "rho_adaptive")
    document["certificates"][0]["proof"]["noise_weight"] *= 0.9
    assert "detection: effect of uncertainty and noise" in refused(write(document, tmp_path, sign=True))


def test_a_threshold_whose_decay_does_not_exceed_the_nonlinearity_is_refused(packaged, tmp_path):
    document = packaged("lab_x", "rho_adaptive")
    document["certificates"][0]["proof"]["decay_rate"] = document["certificates"][0]["model"]["lipschitz"]
    found = refused(write(document, tmp_path, sign=True))
    assert "detection: b > alpha kappa_1" in found
    assert "detection: decay b" not in found


def test_a_covariance_bound_cannot_be_understated(packaged, tmp_path):
    document = packaged("lab_x", "askf")
    document["certificates"][0]["proof"]["P"] = [
        [0.9 * v for v in row] for row in document["certificates"][0]["proof"]["P"]
    ]
    assert "augmented: covariance bound" in refused(write(document, tmp_path, sign=True))


def test_a_sliding_term_that_is_too_weak_is_refused(packaged, tmp_path):
    document = packaged("lab_x", "smo")
    document["parameters"]["sliding_gain"][1] *= 0.8
    assert "channels: sliding term exceeds what it cancels" in refused(write(document, tmp_path, sign=True))


@pytest.mark.parametrize(
    ("diagnoser", "parameter", "change"),
    [
        *((name, "margin", 0.99) for name in ("thau", "adaptive_thau", "fast_adaptive", "smo", "rho_adaptive", "askf")),
        *((name, "settling_time", 0.9) for name in ("asmto", "msjfo")),
        *(("hinf", name, 0.99) for name in ("margin", "torque_margin", "torque_settling_time", "rotor_loss_margin")),
        ("thau", "fast_margin", 1.1),
    ],
)
def test_a_margin_is_that_of_the_gains(packaged, tmp_path, diagnoser, parameter, change):
    document = packaged("lab_x", diagnoser)
    values = document["parameters"][parameter]
    values[values.index(max(values))] *= change
    found = refused(write(document, tmp_path, sign=True))
    assert found == {"margins": f"{parameter} not what follows from the gains"}


def test_a_margin_that_is_left_out_is_refused(packaged, tmp_path):
    document = packaged("lab_x", "asmto")
    del document["parameters"]["settling_time"]
    assert refused(write(document, tmp_path, sign=True)) == {"margins": "settling_time not what follows from the gains"}


def test_a_missing_certificate_is_refused(packaged, tmp_path):
    document = packaged("lab_x", "hinf")
    document["certificates"].pop()
    assert "names" in refused(write(document, tmp_path, sign=True))


@pytest.mark.parametrize("key", ["parameters", "certificates", "hashes", "diagnoser"])
def test_an_incomplete_file_is_refused_with_what_is_missing(packaged, tmp_path, key):
    document = packaged("lab_x", "thau")
    del document[key]
    with pytest.raises(DesignError, match=key):
        list(checks(document, tmp_path / "designs" / "lab_x" / "thau.json"))


def test_an_unstable_observer_is_refused_without_a_trace(packaged, tmp_path):
    document = packaged("lab_x", "hinf")
    document["parameters"]["observer_gain"] = [0.0] * len(document["parameters"]["observer_gain"])
    found = refused(write(document, tmp_path, sign=True))
    assert "vz4: bounded real, corner 1" in found
    assert found["vz4: figures"] == "cannot be computed: the observer is unstable"


@pytest.mark.parametrize("damage", [{"observer_gain": [1.0]}, {"observer_gain": "x"}, {}])
def test_damaged_parameters_are_refused_with_a_sentence(packaged, tmp_path, damage):
    document = packaged("lab_x", "hinf") | {"parameters": damage}
    with pytest.raises(DesignError, match="not a complete design file"):
        verify(write(document, tmp_path, sign=True))


@pytest.mark.parametrize("text", ["", "[]", '{"schema": "rotordx design, version 0"}', "nonsense"])
def test_what_is_no_design_is_refused(tmp_path, text):
    path = tmp_path / "x.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(DesignError, match=r"x\.json"):
        verify(path)
