"""Orbit Ephemeris Messages against the reader `oem` (MIT licence), and the standard's own example.

Both read the same files. Times and states must be the same to the last digit that the file has;
what `oem` refuses as malformed, and what is no Earth-fixed or known inertial frame, is refused here
in words.
"""

import re

import numpy as np
import pytest
from astropy.time import Time
from oem import OrbitEphemerisMessage
from opir_readers.celestial_frames import ecef_state
from opir_readers.oem_table import oem_table

from opir_core.plugin import BadFileError

EPOCH = np.datetime64("2026-04-01T12:00:00", "us")
EPOCH_US = int(EPOCH.astype(np.int64))

HEADER = "CCSDS_OEM_VERS = {version}\nCREATION_DATE = 2026-03-31T00:00:00\nORIGINATOR = TEST\n"
METADATA = """META_START
OBJECT_NAME = ONE
OBJECT_ID = 2026-001A
CENTER_NAME = EARTH
REF_FRAME = {frame}
TIME_SYSTEM = UTC
START_TIME = {start}
STOP_TIME = {stop}
META_STOP
"""
COVARIANCE = """COVARIANCE_START
EPOCH = 2026-04-01T12:00:10
COV_REF_FRAME = RTN
{first}EPOCH = 2026-04-01T12:00:20
{second}COVARIANCE_STOP
"""


def covariance():
    rows = [
        "".join(
            " ".join(f"{0.1 * scale * (row + column + 1):.7e}" for column in range(row + 1)) + "\n"
        )
        for scale in (1.0, 2.0)
        for row in range(6)
    ]
    return COVARIANCE.format(first="".join(rows[:6]), second="".join(rows[6:]))


def stamp(time_s, form="%Y-%m-%dT%H:%M:%S"):
    moment = (EPOCH + np.timedelta64(round(time_s * 1e6), "us")).item()
    return f"{moment.strftime(form)}.{moment.microsecond:06d}"


def segment(
    time_s,
    *,
    frame="ITRF2014",
    widths=9,
    seed=1,
    form="%Y-%m-%dT%H:%M:%S",
    number="{!r}",
    blank=" ",
):
    """Return a segment of states with as many numbers as `widths` says."""
    rng = np.random.default_rng(seed)
    states = rng.normal(size=(len(time_s), 9)) * [
        200.0,
        2e3,
        2e3,
        5.0,
        5.0,
        5.0,
        0.01,
        0.01,
        0.01,
    ] + [7e3, *[0.0] * 8]
    lines = [
        blank.join([stamp(t, form), *(number.format(float(value)) for value in row[:widths])])
        for t, row in zip(time_s, states, strict=True)
    ]
    head = METADATA.format(frame=frame, start=stamp(time_s[0], form), stop=stamp(time_s[-1], form))
    return head + "\n".join(lines) + "\n"


def message(*segments, version="2.0"):
    return HEADER.format(version=version) + "".join(segments)


def by_oem(folder, text):
    """Return scene times (n,) and states (n, 6), m and m/s, as `oem` reads them."""
    path = folder / "message.oem"
    path.write_bytes(text.encode())
    states = OrbitEphemerisMessage.open(path).states
    epoch = Time(str(EPOCH), scale="utc")
    time_s = np.array([(state.epoch - epoch).to_value("s") for state in states])
    return time_s, np.array([[*state.position, *state.velocity] for state in states]) * 1e3


USUAL = segment(np.arange(0.0, 60.0, 7.25), widths=6)
MESSAGES = {
    "states": message(USUAL),
    "version 1.0": message(USUAL, version="1.0"),
    "version 3.0": message(USUAL, version="3.0"),
    "microseconds": message(segment([0.0, 1e-6, 0.5, 0.500001, 86400.25], widths=6)),
    "days of the year": message(segment(np.arange(0.0, 60.0, 10.0), widths=6, form="%Y-%jT%H:%M:%S")),
    "accelerations": message(segment(np.arange(0.0, 60.0, 10.0))),
    "a covariance block": message(USUAL, covariance()),
    "numbers in powers of ten": message(segment([0.0, 1.0, 2.0], widths=6, number="{:.14e}")),
    "tabs": message(segment([0.0, 1.0, 2.0], widths=6, blank="\t  ")),
    "comments and empty lines": message(USUAL)
    .replace("ORIGINATOR", "COMMENT of the header\n\nORIGINATOR")
    .replace("OBJECT_NAME", "COMMENT of the metadata\nOBJECT_NAME")
    .replace("META_STOP\n", "META_STOP\n\nCOMMENT 2026-04-01T12:00:00 1 2 3 4 5 6\n"),
    "line ends of another system": message(USUAL).replace("\n", "\r\n"),
    "keywords without blanks": message(USUAL).replace("META_START\n", "META_START\nINTERPOLATION ="
                                                                      " HERMITE\n"
                                                      "INTERPOLATION_DEGREE = 7\n"),
    "segments that meet": message(
        segment([0.0, 10.0, 20.0], widths=6),
        segment([20.0, 25.0, 30.0], widths=6, seed=2),
        segment([30.0, 31.0], widths=6, seed=3),
    ),
    "segments, each with covariance, one with accelerations": message(
        segment([0.0, 10.0, 20.0], widths=6), covariance(), segment([20.0, 25.0], seed=2), covariance()
    ),
}  # fmt: skip


@pytest.mark.parametrize("text", MESSAGES.values(), ids=MESSAGES)
def test_states_are_those_that_oem_reads(tmp_path, text):
    time_s, states = by_oem(tmp_path, text)
    table = oem_table(text, EPOCH_US, None)
    assert len(time_s) > 1
    np.testing.assert_allclose(table.time_s, time_s, rtol=0.0, atol=3e-7)
    np.testing.assert_array_equal(table.position_m, states[:, :3])
    np.testing.assert_array_equal(table.velocity_m_s, states[:, 3:])
    assert np.diff(table.run).sum() == text.count("META_START") - 1


@pytest.mark.parametrize("frame", ["TEME", "EME2000", "GCRF", "ICRF"])
def test_states_of_inertial_frames_are_those_that_oem_reads_turned(tmp_path, frame):
    text = message(segment(np.arange(0.0, 600.0, 60.0), widths=6, frame=frame))
    time_s, states = by_oem(tmp_path, text)
    table = oem_table(text, EPOCH_US, None)
    expected = ecef_state(
        "TEME" if frame == "TEME" else "EME2000", states[:, :3], states[:, 3:], EPOCH_US, time_s
    )
    np.testing.assert_allclose(table.position_m, expected[0], rtol=0.0, atol=1e-3)
    np.testing.assert_allclose(table.velocity_m_s, expected[1], rtol=0.0, atol=1e-6)


def test_times_within_which_it_may_be_used(tmp_path):
    useable = f"USEABLE_START_TIME = {stamp(7.25)}\nUSEABLE_STOP_TIME = {stamp(29.0)}\nMETA_STOP"
    text = message(USUAL.replace("META_STOP", useable))
    (tmp_path / "message.oem").write_text(text)
    reference = OrbitEphemerisMessage.open(tmp_path / "message.oem").span
    epoch = Time(str(EPOCH), scale="utc")
    expected = [(end - epoch).to_value("s") for end in reference]
    np.testing.assert_allclose(
        oem_table(text, EPOCH_US, None).burns_s, [expected], rtol=0.0, atol=3e-7
    )


MALFORMED = {
    "too few numbers": MESSAGES["states"].rstrip().rpartition(" ")[0],
    "states of two widths": message(
        segment([0.0, 1.0], widths=6) + segment([2.0, 3.0]).partition("META_STOP\n")[2]
    ),
    "a word for a number": re.sub(r"(\S+)\n$", "none\n", MESSAGES["states"]),
    "a keyword twice": MESSAGES["states"].replace("REF_FRAME", "REF_FRAME = TEME\nREF_FRAME"),
    "no frame": MESSAGES["states"].replace("REF_FRAME = ITRF2014\n", ""),
    "no equals sign": MESSAGES["states"].replace("OBJECT_ID =", "OBJECT_ID"),
    "no metadata": MESSAGES["states"].replace("META_START\n", ""),
    "states after a covariance block": message(
        segment([0.0, 1.0], widths=6),
        covariance(),
        segment([2.0, 3.0], widths=6).partition("META_STOP\n")[2],
    ),
}


@pytest.mark.parametrize("text", MALFORMED.values(), ids=MALFORMED)
def test_what_oem_refuses_is_refused_with_its_line(tmp_path, text):
    (tmp_path / "message.oem").write_text(text)
    with pytest.raises(Exception, match=r"."):
        _ = OrbitEphemerisMessage.open(tmp_path / "message.oem").states
    with pytest.raises(BadFileError, match=r"^line \d+: |has no META_START"):
        oem_table(text, EPOCH_US, None)


#: CCSDS 502.0-B-3 (2023), annex G, the example of an OEM without accelerations: its metadata and
#: first three states.
OF_THE_STANDARD = """CCSDS_OEM_VERS = 3.0
CREATION_DATE = 1996-11-04T17:22:31
ORIGINATOR = NASA/JPL
META_START
OBJECT_NAME = MARS GLOBAL SURVEYOR
OBJECT_ID = 1996-062A
CENTER_NAME = {center}
REF_FRAME = EME2000
TIME_SYSTEM = UTC
START_TIME = 1996-12-18T12:00:00.331
USEABLE_START_TIME = 1996-12-18T12:00:10.331
USEABLE_STOP_TIME = 1996-12-18T12:01:50.331
STOP_TIME = 1996-12-18T12:02:00.331
INTERPOLATION = HERMITE
INTERPOLATION_DEGREE = 7
META_STOP
COMMENT a file of navigation
1996-12-18T12:00:00.331 2789.619 -280.045 -1746.755 4.73372 -2.49586 -1.04195
1996-12-18T12:01:00.331 2783.419 -308.143 -1877.071 5.18604 -2.42124 -1.99608
1996-12-18T12:02:00.331 2776.033 -336.859 -2008.682 5.63678 -2.33951 -1.94687
"""


def test_the_standards_own_example_is_of_another_planet_and_reported_so(tmp_path):
    text = OF_THE_STANDARD.format(center="MARS BARYCENTER")
    assert len(by_oem(tmp_path, text)[0]) == 3
    with pytest.raises(
        BadFileError, match="line 16: CENTER_NAME is 'MARS BARYCENTER'; only EARTH is taken"
    ):
        oem_table(text, EPOCH_US, None)


def test_its_states_would_be_deep_in_the_earth_and_that_is_reported():
    with pytest.raises(
        BadFileError, match=r"line 18: the position is 3\.30326e\+06 m from the Earth's centre"
    ):
        oem_table(OF_THE_STANDARD.format(center="EARTH"), EPOCH_US, None)
