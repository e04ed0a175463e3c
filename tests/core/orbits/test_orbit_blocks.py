"""The `orbit:` block as a scene's reader reads it: what is good, and the words for what is not."""

import subprocess
import sys

import pytest
from attrs import asdict, frozen
from space_station import LINE_1, LINE_2, OMM

from opir_core.orbits import OrbitConfig
from opir_core.plugin import nested
from opir_core.reading import InvalidNode, class_reader, node_of_data, node_of_yaml

KINDS = "slot, kepler, circular, walker, molniya, tundra, tle, omm, omm_file"
CIRCULAR = {"altitude_km": 1200.0, "inclination_deg": 53.0, "lon_asc_node_deg": 0.0}
KEPLER = {"semi_major_axis_km": 26562.0, "eccentricity": 0.7, "inclination_deg": 63.4}
WALKER = {**CIRCULAR, "total": 24, "planes": 6, "phasing": 1, "satellite": 1}


def flow(settings, **more):
    """Return settings as YAML on one line."""
    return "{" + ", ".join(f"{key}: {value}" for key, value in {**settings, **more}.items()) + "}"


@frozen(kw_only=True)
class Carrier:
    orbit: OrbitConfig | None = nested(default=None, help="where it flies")


def read(text):
    return class_reader(Carrier)(node_of_yaml(text)).orbit


def read_data(orbit):
    return class_reader(Carrier)(node_of_data({"orbit": orbit})).orbit


def complaints(orbit):
    with pytest.raises(InvalidNode) as caught:
        read_data(orbit)
    return [(complaint.path, complaint.message) for complaint in caught.value.complaints]


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("orbit: {slot: {lon_deg: -75}}", "slot"),
        ("orbit: {slot: {lon_deg: 285, inclination_deg: 5.5, eccentricity: 1e-3}}", "slot"),
        ("orbit: {kepler: " + flow(KEPLER, raan_deg=10, true_anomaly_deg=180) + "}", "kepler"),
        (
            "orbit: {kepler: " + flow(KEPLER, lon_asc_node_deg=10, mean_anomaly_deg=-7.5) + "}",
            "kepler",
        ),
        (
            "orbit: {circular: {altitude_km: 1200, inclination_deg: 53, lon_asc_node_deg: -10}}",
            "circular",
        ),
        ("orbit: {walker: " + flow(WALKER) + "}", "walker"),
        ("orbit: {molniya: {apogee_lon_deg: 90}}", "molniya"),
        ("orbit: {tundra: {apogee_lon_deg: -95, eccentricity: 0.25}}", "tundra"),
        (f"orbit:\n  tle:\n  - {LINE_1}\n  - {LINE_2}", "tle"),
        (f"orbit:\n  tle:\n  - '{LINE_1}'\n  - '{LINE_2}'", "tle"),
        ("orbit: {omm_file: {path: omm.json, satellite: '25544'}}", "omm_file"),
    ],
)
def test_every_kind_is_read_and_written_back(text, kind):
    orbit = read(text)
    assert [
        name
        for name in OrbitConfig.__slots__
        if getattr(orbit, name, None) is not None and name[0] != "_"
    ] == [kind]
    assert read_data(asdict(orbit)) == orbit


def test_an_omm_is_read_as_yaml_and_as_json_would_give_it():
    lines = "\n".join(f"    {key}: {value}" for key, value in OMM.items())
    assert read(f"orbit:\n  omm:\n{lines}").omm == OMM
    assert (
        read_data({"omm": {key: str(value) for key, value in OMM.items()}}).omm["MEAN_MOTION"]
        == "15.72125391"
    )


@pytest.mark.parametrize(
    ("orbit", "path", "words"),
    [
        ({}, "orbit", f"give one of {KINDS}"),
        ({"slot": None}, "orbit", f"give one of {KINDS}"),
        (
            {"slot": {"lon_deg": 1.0}, "tle": [LINE_1, LINE_2]},
            "orbit",
            "slot and tle exclude each other",
        ),
        ({"slot": {"lon_deg": 400.0}}, "orbit.slot.lon_deg", "400.0 is outside [-180, 360] deg"),
        (
            {"slot": {"lon_deg": 0.0, "eccentricity": 0.9}},
            "orbit.slot",
            "the perigee is 4216.4 km from the Earth's centre, inside the Earth (6378.137 km)",
        ),
        (
            {"molniya": {"apogee_lon_deg": 0.0, "eccentricity": 0.8}},
            "orbit.molniya",
            "the perigee is 5312.4 km",
        ),
        (
            {"circular": {**CIRCULAR, "raan_deg": 1.0}},
            "orbit.circular",
            "lon_asc_node_deg and raan_deg exclude",
        ),
        (
            {"kepler": {**KEPLER, "raan_deg": 1.0}},
            "orbit.kepler",
            "give one of mean_anomaly_deg, true_anomaly_deg",
        ),
        (
            {"kepler": {**KEPLER, "eccentricity": 1.0}},
            "orbit.kepler.eccentricity",
            "1.0 is outside [0, 1)",
        ),
        (
            {"walker": {**WALKER, "planes": 5}},
            "orbit.walker",
            "24 satellites cannot be shared evenly among 5 planes",
        ),
        (
            {"walker": {**WALKER, "phasing": 6}},
            "orbit.walker",
            "phasing: 6 is not in [0, 6), the number of planes",
        ),
        (
            {"walker": {**WALKER, "satellite": 25}},
            "orbit.walker",
            "satellite: 25 is more than the 24 of the pattern",
        ),
        ({"tle": [LINE_1]}, "orbit.tle", "this list has 1 items; 2 are needed"),
        (
            {"tle": [LINE_1[:-1], LINE_2]},
            "orbit.tle",
            "line 1 has 68 characters, not the 69 of a TLE",
        ),
        ({"tle": [LINE_2, LINE_1]}, "orbit.tle", "line 1 starts with '2 ', not 1 and a blank"),
        (
            {"tle": [LINE_1[:-1] + "8", LINE_2]},
            "orbit.tle",
            "line 1 has the checksum 8, and its digits come to 7",
        ),
        (
            {"tle": [LINE_1, LINE_2.replace("51.6416", "51.64.6")[:-1] + "6"]},
            "orbit.tle",
            "line 2 has no number for the inclination in columns 9 to 16: ' 51.64.6'",
        ),
        (
            {"tle": [LINE_1, LINE_2.replace("25544", "25545")[:-1] + "8"]},
            "orbit.tle",
            "the lines are of two objects, 25544 and 25545",
        ),
        (
            {"tle": [LINE_1[:62] + "4" + LINE_1[63:-1] + "1", LINE_2]},
            "orbit.tle",
            "these are elements for SGP4-XP (ephemeris type 4), a theory that is not public",
        ),
        ({"omm": {"EPOCH": OMM["EPOCH"]}}, "orbit.omm", "MEAN_MOTION, ECCENTRICITY, INCLINATION"),
        (
            {"omm": {**OMM, "MEAN_MOTION": "fast"}},
            "orbit.omm",
            "MEAN_MOTION: 'fast' is not a number",
        ),
        ({"omm": {**OMM, "MEAN_MOTION": True}}, "orbit.omm", "MEAN_MOTION: True is not a number"),
        (
            {"omm": {**OMM, "MEAN_MOTION": 157.0}},
            "orbit.omm",
            "MEAN_MOTION: 157.0 is outside (0, 18] turns a day",
        ),
        (
            {"omm": {**OMM, "ECCENTRICITY": "nan"}},
            "orbit.omm",
            "ECCENTRICITY: 'nan' is not a number",
        ),
        ({"omm": {**OMM, "ECCENTRICITY": 1.0}}, "orbit.omm", "ECCENTRICITY: 1.0 is outside [0, 1)"),
        (
            {"omm": {**OMM, "INCLINATION": -1}},
            "orbit.omm",
            "INCLINATION: -1.0 is outside [0, 180] deg",
        ),
        (
            {"omm": {**OMM, "EPOCH": "yesterday"}},
            "orbit.omm",
            "EPOCH: 'yesterday' is not a time in UTC",
        ),
        (
            {"omm": {**OMM, "EPOCH": "2008-09-20T12:00:00+02:00"}},
            "orbit.omm",
            "is not a time in UTC",
        ),
        ({"omm": {**OMM, "REF_FRAME": "GCRF"}}, "orbit.omm", "REF_FRAME: 'GCRF' is not TEME"),
        ({"omm": {**OMM, "TIME_SYSTEM": "TAI"}}, "orbit.omm", "TIME_SYSTEM: 'TAI' is not UTC"),
        (
            {"omm": {**OMM, "MEAN_ELEMENT_THEORY": "DSST"}},
            "orbit.omm",
            "MEAN_ELEMENT_THEORY: 'DSST' is not SGP4",
        ),
        ({"omm": {**OMM, "EPHEMERIS_TYPE": 4}}, "orbit.omm", "SGP4-XP"),
        ({"leo": {}}, "orbit.leo", "unknown key"),
    ],
)
def test_what_is_wrong_is_said_where_it_stands(orbit, path, words):
    errors = complaints(orbit)
    assert errors[0][0] == path
    assert words in errors[0][1]
    assert len(errors) == 1


def test_naming_orbits_imports_neither_numpy_nor_sgp4():
    code = (
        "import sys; from opir_core.orbits import OrbitConfig, walker_pattern;"
        "walker_pattern(24, 6, 1, 1.2e6, 0.9);"
        "assert not {'numpy', 'sgp4'} & sys.modules.keys(), sorted(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def with_checksum(line):
    """Return the 68 characters of a line of a TLE with their checksum."""
    return line + str(
        sum(int(character) if character.isdigit() else character == "-" for character in line) % 10
    )


@pytest.mark.parametrize(
    ("field", "reported"),
    [
        ("1.16e-05", "' 11600-4'"),
        (" 1.16e-5", "' 11600-4'"),
        ("-.000012", "'-12000-4'"),
        (".0000116", "' 11600-4'"),
        (
            " 11606 4",
            "a sign or a blank, five digits, and the power of ten with its sign, like ' 11606-4'",
        ),
        ("11606-4 ", "a sign or a blank, five digits"),
        ("00011606", "a sign or a blank, five digits"),
        (" 11606E4", "a sign or a blank, five digits"),
        ("        ", "a sign or a blank, five digits"),
        ("    nan ", "a sign or a blank, five digits"),
    ],
)
def test_an_invalid_drag_term_is_reported_with_its_columns(field, reported):
    ((path, message),) = complaints(
        {"tle": [with_checksum(f"{LINE_1[:53]}{field}{LINE_1[61:68]}"), LINE_2]}
    )
    assert path == "orbit.tle"
    head = f"line 1 has no number for the drag term B* in columns 54 to 61: {field!r}; write "
    assert message.startswith(f"{head}{reported}")


@pytest.mark.parametrize(
    "field", [" 11606-4", "-11606-4", "+11606-4", " 00000-0", " 00000+0", " 00000 0", " 13519-0"]
)
def test_drag_terms_as_they_are_published_are_read(field):
    assert read_data({"tle": [with_checksum(f"{LINE_1[:53]}{field}{LINE_1[61:68]}"), LINE_2]}).tle


@pytest.mark.parametrize(
    ("line", "start", "text", "reported"),
    [
        (
            1,
            53,
            " 11606+4",
            "line 1 has the drag term B* 1160.6, more than any satellite's (10); is a sign lost?",
        ),
        (
            1,
            44,
            " 1.2e-05",
            "line 1 has no number for the mean motion's second derivative in columns 45 to 52",
        ),
        (
            1,
            18,
            "082645178252  ",
            "line 1 has no number for the epoch in columns 19 to 32: '082645178252  '",
        ),
        (
            2,
            26,
            " .00067",
            "line 2 has no number for the eccentricity in columns 27 to 33: ' .00067'",
        ),
        (2, 8, "251.6416", "line 2 has the inclination 251.642, outside [0, 180] deg"),
        (2, 52, "85.72125391", "line 2 has the mean motion 85.7213, outside (0, 18] turns a day"),
        (
            2,
            43,
            "        ",
            "line 2 has no number for the mean anomaly in columns 44 to 51: '        '",
        ),
    ],
)
def test_every_field_of_a_tle_is_named(line, start, text, reported):
    lines = [LINE_1, LINE_2]
    was = lines[line - 1]
    lines[line - 1] = with_checksum(f"{was[:start]}{text}{was[start + len(text) : 68]}")
    ((_, message),) = complaints({"tle": lines})
    assert message.startswith(reported)


def test_all_errors_of_a_tle_and_of_an_omm_are_reported_at_once():
    lines = [f"{LINE_1[:53]}1.16e-05{LINE_1[61:68]}9", LINE_2.replace("0006703", " .00067")]
    ((_, message),) = complaints({"tle": lines})
    heads = [words.partition(" has ")[0] for words in message.split("; ") if " has " in words]
    assert heads == ["line 1", "line 1", "line 2", "line 2"]
    wrong = {"BSTAR": "1,2e-5", "INCLINATION": 200, "EPOCH": "now", "TIME_SYSTEM": "TAI"}
    ((_, message),) = complaints({"omm": {**OMM, **wrong}})
    assert [words.partition(":")[0] for words in message.split("; ")] == [
        "TIME_SYSTEM",
        "BSTAR",
        "INCLINATION",
        "EPOCH",
    ]


def test_a_character_that_no_tle_has_is_named():
    ((_, message),) = complaints({"tle": [LINE_1.replace("-11606-4", "−11606-4"), LINE_2]})
    assert (
        message == "line 1 has the character '−' (U+2212), which no TLE has; copy it as plain text"
    )
