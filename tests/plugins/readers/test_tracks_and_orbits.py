"""GPX, KML, SP3 and OEM in XML: the same places as the same flight in other forms, and what lacks
is reported.
"""

import gzip
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
from pyproj import Transformer
from read_files import read, recognised, refusal

START = datetime(2026, 4, 1, 12)
LON, LAT, HEIGHT = (
    np.array(values)
    for values in ([-120.57, -120.58, -120.6], [34.73, 34.74, 34.75], [100.0, 900.0, 2e3])
)
PLACES = np.stack(
    Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True).transform(LON, LAT, HEIGHT),
    axis=1,
)
TIMES = [START + timedelta(seconds=10.5 * k) for k in range(3)]

GPX = """<?xml version="1.0" encoding="UTF-8"?>
<gpx version="1.1" creator="own" xmlns="http://www.topografix.com/GPX/1/1">
<trk><name>ONE</name><trkseg>
{points}
</trkseg></trk>{more}</gpx>
"""
KML = """<?xml version="1.0" encoding="UTF-8"?>
<kml xmlns="http://www.opengis.net/kml/2.2" xmlns:gx="http://www.google.com/kml/ext/2.2"><Document>
<Placemark><name>ONE</name><gx:Track><altitudeMode>{mode}</altitudeMode>
{whens}
{coords}
</gx:Track></Placemark></Document></kml>
"""


def gpx(more=""):
    rows = zip(LAT.tolist(), LON.tolist(), HEIGHT.tolist(), TIMES, strict=True)
    points = [
        f'<trkpt lat="{a}" lon="{o}"><ele>{h}</ele><time>{t.isoformat()}Z</time></trkpt>'
        for a, o, h, t in rows
    ]
    return GPX.format(points="\n".join(points), more=more)


def kml(mode="absolute"):
    rows = zip(LON.tolist(), LAT.tolist(), HEIGHT.tolist(), strict=True)
    coords = "\n".join(f"<gx:coord>{o} {a} {h}</gx:coord>" for o, a, h in rows)
    whens = "\n".join(f"<when>{t.isoformat()}Z</when>" for t in TIMES)
    return KML.format(mode=mode, whens=whens, coords=coords)


@pytest.mark.parametrize(("text", "name"), [(gpx(), "gpx"), (kml(), "kml")])
def test_a_track_has_its_places_and_times(text, name):
    assert recognised(text) == [name]
    table = read(name, text)
    np.testing.assert_allclose(table.time_s, [0.0, 10.5, 21.0], rtol=0.0, atol=1e-6)
    np.testing.assert_allclose(table.position_m, PLACES, rtol=0.0, atol=1e-6)
    assert table.velocity_m_s is None
    assert table.has_dates
    assert "above mean sea level" in table.notes[0]
    assert read(name, text, object="ONE").time_s[0] == 0.0


def test_one_of_several_tracks_is_asked_for():
    second = (
        "<trk><name>TWO</name><trkseg>"
        + gpx().split("<trkseg>")[1].split("</trkseg>")[0]
        + "</trkseg></trk>"
    )
    assert "has several tracks; say which with object: ONE, TWO" in refusal("gpx", gpx(second))
    assert len(read("gpx", gpx(second), object="TWO").time_s) == 3


@pytest.mark.parametrize(
    ("name", "text", "reported"),
    [
        (
            "gpx",
            gpx().replace("<time>2026-04-01T12:00:10.500000Z</time>", ""),
            "line 5: this trkpt has no time",
        ),
        ("gpx", gpx().replace("34.74", "north"), "line 5: lat is 'north', not a finite number"),
        (
            "gpx",
            gpx().replace("34.74", "95"),
            "line 5: latitude 95 and longitude -120.58 deg are no place",
        ),
        ("gpx", gpx().replace("</gpx>", ""), "line 8: is not XML: no element found"),
        (
            "gpx",
            "<!DOCTYPE a [<!ENTITY b 'c'>]>\n<gpx/>",
            "has a document type, which is not read",
        ),
        (
            "kml",
            kml("relativeToGround"),
            "altitudeMode is relativeToGround; export absolute heights",
        ),
        (
            "kml",
            kml().replace("<when>2026-04-01T12:00:00Z</when>", ""),
            "has 2 times and 3 places",
        ),
        (
            "kml",
            "<kml><Placemark><LineString/></Placemark></kml>",
            "it has 1 lines of places without times",
        ),
        ("oem-xml", "<oem/>", "has no segment"),
        ("oem-xml", "<oem><segment/></oem>", "line 1: this segment has no metadata"),
    ],
)
def test_what_is_wrong_with_a_track_is_reported(name, text, reported):
    assert reported in refusal(name, text)


def test_deep_xml_is_refused():
    assert "is nested deeper than 64 elements" in refusal("gpx", "<a>" * 100_000)


STATES = [
    (0.0, [-5600.0, -2600.0, 2900.0], [1.5, -5.2, 2.6]),
    (10.0, [-5584.9, -2651.9, 2925.9], [1.52, -5.18, 2.58]),
    (20.0, [-5569.6, -2703.6, 2951.6], [1.54, -5.16, 2.56]),
]
META = {
    "OBJECT_NAME": "ONE",
    "OBJECT_ID": "2026-001A",
    "CENTER_NAME": "EARTH",
    "REF_FRAME": "EME2000",
    "TIME_SYSTEM": "TAI",
    "START_TIME": "2026-04-01T12:00:37",
    "STOP_TIME": "2026-04-01T12:00:57",
}


def oem_pair(meta, covariance=True):
    """Return the same message in both forms."""
    times = [f"2026-04-01T12:00:{37 + t:06.3f}" for t, _, _ in STATES]
    lines = [f"{key} = {value}" for key, value in meta.items()]
    rows = [" ".join(map(str, [t, *p, *v])) for t, (_, p, v) in zip(times, STATES, strict=True)]
    kvn = "\n".join(["CCSDS_OEM_VERS = 2.0", "META_START", *lines, "META_STOP", *rows])
    names = ["X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT"]
    xml = [
        '<?xml version="1.0"?>',
        "<ndm>",
        '<oem id="CCSDS_OEM_VERS" version="2.0"><header/><body><segment><metadata>',
    ]
    xml += [f"<{key}>{value}</{key}>" for key, value in meta.items()] + [
        "</metadata><data><COMMENT>own</COMMENT>"
    ]
    for time, (_, place, velocity) in zip(times, STATES, strict=True):
        cells = [
            f'<{n} units="{"km/s" if "DOT" in n else "km"}">{v}</{n}>'
            for n, v in zip(names, place + velocity, strict=True)
        ]
        xml.append(f"<stateVector><EPOCH>{time}</EPOCH>{''.join(cells)}</stateVector>")
    if covariance:
        kvn += "\nCOVARIANCE_START\nEPOCH = 2026-04-01T12:00:37\n1\nCOVARIANCE_STOP"
        xml.append(
            "<covarianceMatrix><EPOCH>2026-04-01T12:00:37</EPOCH><CX_X>1</CX_X></covarianceMatrix>"
        )
    return kvn, "\n".join([*xml, "</data></segment></body></oem></ndm>"])


def test_both_forms_of_an_oem_have_the_same_states(imported):
    kvn, xml = oem_pair(META)
    assert recognised(xml) == ["oem-xml"]
    plain = read("oem", kvn)
    tagged = read("oem-xml", xml, object="ONE")
    np.testing.assert_allclose(tagged.time_s, [0.0, 10.0, 20.0], rtol=0.0, atol=1e-6)
    for name in ("time_s", "position_m", "velocity_m_s", "run", "burns_s"):
        np.testing.assert_array_equal(getattr(plain, name), getattr(tagged, name))
    assert plain.notes == tagged.notes == ("covariances are not read",)
    assert plain.frame == "EME2000, times in TAI"
    assert tagged.line_of(1) == 13
    Path("one.xml").write_text(xml)
    Path("one.xml.gz").write_bytes(gzip.compress(xml.encode()))
    assert imported("one.xml.gz").replace(".gz", "") == imported("one.xml")


def test_units_of_an_xml_state_are_checked():
    _, xml = oem_pair(META)
    in_metres = xml.replace('<X units="km">', '<X units="m">', 1)
    assert "X is in m; km is due" in refusal("oem-xml", in_metres)
    assert "this state lacks Z_DOT" in refusal("oem-xml", xml.replace("Z_DOT", "W_DOT"))


SP3 = """#{version}2026  4  1 12  0  0.00000000       3 ORBIT IGS20 HLM  IGS
## 2412 302400.00000000   900.00000000 61131 0.5000000000000
+    2   G01R07  0  0  0  0  0  0  0  0  0  0  0  0  0  0  0
++         2  2
%c M  cc {system} ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc
%c cc cc ccc ccc cccc cccc cccc cccc ccccc ccccc ccccc ccccc
/* OWN MAKING
"""


def sp3(system="GPS", velocities=False):
    lines = [SP3.format(version="dV" if velocities else "cP", system=system).rstrip("\n")]
    for k in range(3):
        lines.append(f"*  2026  4  1 12 {15 * k:2d}  0.00000000")
        lines.append(f"PG01{15600.5 + k:14.6f}{-14000.25:14.6f}{16200.1:14.6f}{120.5:14.6f}")
        lines += (
            [f"VG01{12345.6:14.6f}{-20000.0 + k:14.6f}{500.0:14.6f}{1.0:14.6f}"]
            if velocities
            else []
        )
        lines.append(f"PR07{0.0:14.6f}{0.0:14.6f}{0.0:14.6f}{999999.999999:14.6f}")
    return "\n".join([*lines, "EOF", ""])


@pytest.mark.parametrize(
    ("system", "ahead_s"), [("GPS", 18.0), ("UTC", 0.0), ("TAI", 37.0), ("BDT", 4.0), ("GAL", 18.0)]
)
def test_an_sp3_orbit_has_its_places_in_metres_and_times_in_utc(system, ahead_s):
    text = sp3(system, velocities=True)
    assert recognised(text) == ["sp3"]
    table = read("sp3", text)
    np.testing.assert_allclose(
        table.time_s, np.array([0.0, 900.0, 1800.0]) - ahead_s, rtol=0.0, atol=1e-6
    )
    np.testing.assert_allclose(table.position_m[1], [15601.5e3, -14000.25e3, 16200.1e3])
    np.testing.assert_allclose(table.velocity_m_s[1], [1234.56, -1999.9, 50.0])
    assert table.frame == "IGS20"
    assert table.line_of(0) == 9


def test_positions_that_are_missing_are_no_states():
    assert refusal("sp3", sp3(), object="R07") == "has no satellite 'R07'; it has G01"
    assert read("sp3", sp3(), object="G01").velocity_m_s is None


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        (sp3("LOC"), "has times in 'LOC'"),
        (sp3().replace("* ", "* x"), "is no epoch"),
        (sp3().replace("15601.500000", "x5601.500000"), "columns 5 to 46 are not three numbers"),
        (
            sp3().replace("PR07", "PG02").replace("      0.000000", "  15000.000000"),
            "has 2 satellites; say which with object",
        ),
    ],
)
def test_what_is_wrong_with_an_sp3_orbit_is_reported(text, reported):
    assert reported in refusal("sp3", text)


def test_a_point_without_a_height_is_refused():
    """At height 0 it would fly along the ellipsoid."""
    text = gpx()
    level = text[: text.index("<ele>")] + text[text.index("</ele>") + 6 :]
    assert "line 4: this trkpt has no ele, its height" in refusal("gpx", level)
