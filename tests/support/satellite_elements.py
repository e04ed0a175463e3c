"""Elements of two satellites as a catalogue gives them: two-line elements, and OMM in each form."""

import json

LINES = (
    "1 25544U 98067A   26091.50000000  .00000000  00000-0  11606-4 0  9991",
    "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
)
SECOND = (
    "1 25545U 98067B   26071.50000000  .00000000  00000-0  11606-4 0  9990",
    "2 25545  97.6416 247.4627 0006703 130.5360 325.0288 15.72125391563538",
)
OMM = {
    "OBJECT_NAME": "ISS (ZARYA)",
    "OBJECT_ID": "1998-067A",
    "NORAD_CAT_ID": 25544,
    "EPOCH": "2026-04-01T12:00:00",
    "MEAN_MOTION": 15.72125391,
    "ECCENTRICITY": 0.0006703,
    "INCLINATION": 51.6416,
    "RA_OF_ASC_NODE": 247.4627,
    "ARG_OF_PERICENTER": 130.5360,
    "MEAN_ANOMALY": 325.0288,
    "BSTAR": 0.11606e-4,
    "EPHEMERIS_TYPE": 0,
}
OTHER = {
    **OMM,
    "OBJECT_NAME": "TWO",
    "NORAD_CAT_ID": 5,
    "INCLINATION": 97.0,
    "EPOCH": "2026-03-12T12:00:00",
}


def omm_texts(rows):
    """Return the same messages in each form."""
    csv = "\n".join([",".join(rows[0]), *(",".join(map(str, row.values())) for row in rows)])
    kvn = "\n".join(
        "\n".join(["CCSDS_OMM_VERS = 2.0", *(f"{k} = {v}" for k, v in row.items())]) for row in rows
    )
    blocks = []
    for row in rows:
        cells = {name: f"<{name}>{value}</{name}>" for name, value in row.items()}
        meta = "".join(cells[name] for name in ("OBJECT_NAME", "OBJECT_ID"))
        mean = "".join(
            cells[name] for name in ("EPOCH", "MEAN_MOTION", "ECCENTRICITY", "INCLINATION")
        )
        mean += "".join(
            cells[name] for name in ("RA_OF_ASC_NODE", "ARG_OF_PERICENTER", "MEAN_ANOMALY")
        )
        tle = "".join(cells[name] for name in ("EPHEMERIS_TYPE", "NORAD_CAT_ID", "BSTAR"))
        data = f"<meanElements>{mean}</meanElements><tleParameters>{tle}</tleParameters>"
        body = f"<metadata>{meta}</metadata><data>{data}"
        blocks.append(
            f'<omm id="CCSDS_OMM_VERS"'
            f' version="2.0"><body><segment>{body}</data></segment></body></omm>'
        )
    return {
        "json": json.dumps(rows),
        "csv": csv,
        "kvn": kvn,
        "xml": f"<ndm>{''.join(blocks)}</ndm>",
    }


TLE = "\n".join(["ISS (ZARYA)", *LINES, "0 TWO", *SECOND, ""])
