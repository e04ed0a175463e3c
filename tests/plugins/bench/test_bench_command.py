"""`opir physics` on the command line: tables, JSON, plots, frames and refusals."""

import json
import math

import numpy as np
import pytest
from repository import ROOT

from opir_core.cli.main import main

SCENE = str(ROOT / "examples" / "photons.yaml")
WITHOUT_PLANE = ["--set", "sensors[0].focal_plane=null", "--set", "sensors[0].nei_w_m2=4e-12"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ["budget", "--sensor", "SBIRS-GEO"],
        ["budget", "--sensor", "DSP", *WITHOUT_PLANE],
        ["budget", SCENE, "--sensor", "SBIRS-1", "--waterfall", "--band", "SWIR"],
        ["curve", "--sensor", "DSP", "--of", "pd", "--values", "1,10"],
        [
            "curve",
            "--sensor",
            "DSP",
            "--of",
            "first-report",
            "--against",
            "elevation",
            "--values",
            "20,60",
        ],
        ["roc", SCENE],
        ["false-alarms", "--sensor", "NEXTGEN-GEO"],
        ["window", "--sensor", "NEXTGEN-GEO"],
        [
            "bands",
            "--sensor",
            "SBIRS-GEO",
            "--class",
            "SRBM",
            "--heights",
            "5,20",
            "--edges",
            "2.5,3,4,5",
        ],
    ],
)
def test_results_are_printed_as_data_and_drawn(words, tmp_path, capsys):
    picture = tmp_path / "plot.png"
    assert main(["physics", *words, "--json", "--plot", str(picture)]) == 0
    text = capsys.readouterr().out
    result, _ = json.JSONDecoder().raw_decode(text)
    assert result["rows"]
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_frame_is_written_as_picture_and_arrays(tmp_path):
    words = ["--sensor", "SBIRS-GEO", "--pixels", "32"]
    assert main(["physics", "frame", *words, "-o", str(tmp_path / "frame")]) == 0
    with np.load(tmp_path / "frame" / "frame.npz") as arrays:
        assert arrays["electrons"].shape == arrays["mask"].shape == (32, 32)
        assert arrays["mask"][16, 16]
    assert (tmp_path / "frame" / "frame.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "reported"),
    [
        (["budget"], "give a scene, or a sensor model"),
        (["budget", SCENE, "--sensor", "S9"], "'S9' is not one of DSP-1"),
        (["frame", "--sensor", "DSP", *WITHOUT_PLANE], "has no focal plane"),
        (["curve", "--sensor", "DSP", "--of", "first-report"], "of a whole boost"),
        (["bands", "--sensor", "DSP", *WITHOUT_PLANE], "nei_w_m2 states its noise"),
        (["bands", "--sensor", "DSP", "--edges", "2,3", "--least-width", "2"], "are as far apart"),
        (["bands", "--sensor", "DSP", "--edges", "2,3"], "has none of these bands"),
    ],
)
def test_what_is_missing_is_reported(words, reported, tmp_path, capsys):
    assert main(["physics", *words]) != 0
    assert reported in capsys.readouterr().err


def test_the_formula_of_the_paper_is_still_there(capsys):
    assert main(["physics", "min-intensity", "--unit", "W/m2"]) == 0
    assert capsys.readouterr().out == "NEI 5e-14 W/m2: 324 W/sr\n"


@pytest.mark.parametrize(("rule", "joined"), [("none", max), ("likelihood", math.hypot)])
def test_bands_are_compared_by_the_rule_over_bands(rule, joined, capsys):
    own = ["--sensor", "SBIRS-GEO", "--set", f"sensors[0].spectral_discrimination={rule}"]
    limits = ["--edges", "2.5,3,4,5", "--class", "SRBM", "--height", "20"]
    assert main(["physics", "bands", *own, *limits, "--json"]) == 0
    *alone, total = json.loads(capsys.readouterr().out)["rows"]
    snr = {(row["from um"], row["to um"]): row["SNR"] for row in alone}
    assert total["SNR"] == pytest.approx(joined(snr[2.5, 3.0], snr[4.0, 5.0]), rel=1e-3)


def test_a_satellite_of_a_constellation_is_put_on_the_bench(tmp_path, capsys):
    scene = tmp_path / "fleet.yaml"
    scene.write_text(
        "scene: fleet\nepoch: 2026-04-01T12:00:00Z\nduration_s: 1\natmosphere: lowtran\n"
        "sensors: [{constellation: SBIRS-GEO}]\ntargets: []\n"
    )
    assert main(["physics", "budget", str(scene), "--sensor", "SBIRS-GEO-3"]) == 0
    assert "one look of SBIRS-GEO-3" in capsys.readouterr().out
    assert main(["physics", "budget", str(scene), "--sensor", "SBIRS-GEO-9"]) == 4
    assert "is not one of SBIRS-GEO-1, SBIRS-GEO-2" in capsys.readouterr().err
