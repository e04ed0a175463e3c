"""What a user of `detection: snr` may type wrong: each gives one message with its place and the way
out.
"""

import pytest
from repository import EXAMPLES

from opir_core.cli.main import main

SCENE = str(EXAMPLES / "photons.yaml")
NARROW = "sensors[1].bands={SWIR: [2.5, 3.0], MWIR: [3.4, 4.1]}"
RATIOS = "sensors[1].plausible_ratios={SWIR: [40, 90]}"

MISTAKES = {
    "the unit of a noise": (
        ["sensors[0].nei_w_m=1e-12"],
        2,
        "sensors[0].nei_w_m: unknown key; did you mean nei_w_m2?",
    ),
    "noise below zero": (
        ["sensors[0].nei_w_m2=-1"],
        2,
        "sensors[0].nei_w_m2: -1.0 is outside [0, 1000000] W/m²",
    ),
    "noise of a band that is not there": (
        ["sensors[1].band_nei_w_m2={MWR: 1e-12}"],
        2,
        "sensors[1]: band_nei_w_m2: MWR is not one of the sensor's bands, SWIR, MWIR",
    ),
    "ratio of a band that is not there": (
        ["sensors[1].plausible_ratios={LWIR: [0, 1]}"],
        2,
        "sensors[1]: plausible_ratios: LWIR is not one of the sensor's bands, SWIR, MWIR",
    ),
    "no false alarms at all": (
        ["sensors[0].false_alarm_probability=0"],
        2,
        "sensors[0].false_alarm_probability: 0.0 is outside [1e-30, 1)",
    ),
    "cover below zero": (
        ["atmosphere.cloud={cover: -0.5}"],
        2,
        "atmosphere.cloud.cover: -0.5 is outside [0, 1]",
    ),
    "climate": (
        ["atmosphere.climate=arctic"],
        2,
        (
            "atmosphere.climate: 'arctic' is not one of us1976, tropical, midlat_summer, midlat_winter,"
            " subarctic_summer, subarctic_winter"
        ),
    ),
    "a band outside the table": (
        [NARROW],
        4,
        (
            "atmosphere: the band MWIR, 3.4 to 4.1 um, is not one of LOWTRAN's table (SWIR 2.5-3,"
            " SWIR_N 2.69-2.95,"
            " MWIR 4-5, MWIR_N 4.2-4.45, LWIR 8-12, STG_2.0_2.4 2-2.4, MWIRW_3.5_4.0 3.5-4, ABI_07"
            " 3.8-4, ABI_08"
            " 5.77-6.6, ABI_09 6.75-7.15, ABI_10 7.24-7.44, ABI_11 8.3-8.7, ABI_12 9.42-9.8, ABI_13"
            " 10.1-10.6, ABI_14 10.8-11.6, ABI_15 11.8-12.8, ABI_16 13-13.6,"
            " FCI_38 3.6-4, FCI_63 5.8-6.8, FCI_73 7.1-7.6, FCI_87 8.5-8.9, FCI_97 9.51-9.81,"
            " FCI_105 10.15-10.85, FCI_123 12.05-12.55), nor made of them side by side; say"
            " in atmosphere.bands which of them stands for it, as in bands: {MWIR: MWIRW_3.5_4.0}"
        ),
    ),
    "a band outside the background's table": (
        [NARROW, "atmosphere.bands={MWIR: MWIRW_3.5_4.0}"],
        4,
        "say in background.bands which of them stands for it, as in bands: {MWIR: MWIRW_3.5_4.0}",
    ),
    "ratios that leave the reference out": (
        [
            "detection={model: snr, calibrate: paper}",
            RATIOS,
            "sensors[1].spectral_discrimination=dual-band-ratio",
        ],
        4,
        (
            "sensor SBIRS-1 (SBIRS-GEO): calibrate: paper finds no noise with which the reference"
            " ICBM, 1.34e+06,"
            " 1.31e+06 W/sr in the sensor's bands, is detected with probability 0.8; give it bands"
            " and plausible_ratios"
            " that do not leave the ICBM out, or calibrate: none"
        ),
    ),
    "a constant chance for fires": (
        ["detection=constant"],
        4,
        (
            "detection: constant has no probability of detection for the source type fire: choose a"
            " radiometric detection model (detection: snr), or omit the sources"
        ),
    ),
    "an encoder": (["outputs[0].jsonl.encoder=forge-band"], 3, "nearest: forge-bands"),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_reported_with_its_place_and_the_way_out(name, capsys):
    changes, code, message = MISTAKES[name]
    assert (
        main(["validate", SCENE, *(word for change in changes for word in ("--set", change))])
        == code
    )
    reported = capsys.readouterr().err
    assert message in reported
    assert "Traceback" not in reported


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("lat_deg,lon_deg\n40,-110\n95,-110\n", "line 3: lat_deg: 95.0 is outside [-90, 90] deg"),
        ("lat_deg,lon_deg\n40,west\n", "line 2: lon_deg: 'west' is not a number"),
        ("lat_deg,lon_deg\n40\n", "line 2: 1 cells under a header of 2"),
        ("lat_deg,lon_deg,area_m2\n40,-110,-3\n", "line 2: area_m2: -3.0 is outside"),
    ],
)
def test_a_bad_row_of_fires_is_reported_with_file_and_line(text, message, tmp_path, capsys):
    (tmp_path / "fires.csv").write_text(text, encoding="utf-8")
    block = f"sources[0]={{id: fires, model: fires, csv: {tmp_path / 'fires.csv'}}}"
    assert main(["run", SCENE, "--quiet", "--set", block]) == 2
    reported = capsys.readouterr().err
    assert f"sources[0].csv: {tmp_path / 'fires.csv'}, {message}" in reported


@pytest.mark.slow
def test_what_opir_advises_for_a_band_works(capsys):
    advice = [f"{sky}.bands={{MWIR: MWIRW_3.5_4.0}}" for sky in ("atmosphere", "background")]
    assert (
        main(
            [
                "validate",
                SCENE,
                *(word for change in (NARROW, *advice) for word in ("--set", change)),
            ]
        )
        == 0
    )


def test_physics_refuses_what_is_no_number_in_words(capsys):
    for value in ("abc", "-1", "nan", "inf"):
        with pytest.raises(SystemExit):
            main(["physics", "min-intensity", f"--nei={value}"])
        assert f"argument --nei: {value} is not a number above 0" in capsys.readouterr().err
