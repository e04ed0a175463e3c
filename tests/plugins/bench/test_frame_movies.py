"""Movies of frames as training sets: what a loader finds in the folders, and what labels say."""

import json

import matplotlib.image
import numpy as np
import pytest

from opir_core.cli.main import main

WORDS = [
    "--sensor",
    "SBIRS-GEO",
    "--class",
    "SRBM",
    "--pixels",
    "48",
    "--movie",
    "3",
    "--every",
    "1",
    "--snr",
    "5,50",
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("movies") / "SET"
    assert main(["physics", "frame", *WORDS, "--clips", "2", "-o", str(path)]) == 0
    return path


def test_a_loader_finds_pictures_and_masks_by_the_lists(folder):
    """As those of NUDT-SIRST (`img_idx`) and of IRSTD-1k read their sets; the last clip is for
    tests.
    """
    train, test = (
        folder.joinpath("img_idx", f"{part}_SET.txt").read_text().split()
        for part in ("train", "test")
    )
    assert (
        train
        == (folder / "trainval.txt").read_text().split()
        == [f"clip000_{k:04d}" for k in range(3)]
    )
    assert (
        test == (folder / "test.txt").read_text().split() == [f"clip001_{k:04d}" for k in range(3)]
    )
    for name in (*train, *test):
        image, mask = (
            matplotlib.image.imread(folder / each / f"{name}.png") for each in ("images", "masks")
        )
        assert image.shape == mask.shape == (48, 48)
        assert set(np.unique(mask)) <= {0.0, 1.0}
        assert image.std() > 0.05


def test_labels_are_the_extents_of_masks(folder):
    total = json.loads((folder / "annotations.json").read_text())
    files = {each["id"]: each["file_name"] for each in total["images"]}
    assert len(files) == 6
    assert [each["name"] for each in total["categories"]] == ["SRBM"]
    for each in total["annotations"]:
        name = files[each["image_id"]]
        rows, columns = np.nonzero(matplotlib.image.imread(folder / "masks" / name))
        remaining = columns.min()
        top = rows.min()
        wide = columns.max() - remaining + 1
        tall = rows.max() - top + 1
        assert each["bbox"] == [remaining, top, wide, tall]
        assert each["area"] == len(rows)
        assert remaining <= each["center"][0] <= remaining + wide
        label = (folder / "labels" / name).with_suffix(".txt").read_text().split()
        expected = [(remaining + wide / 2) / 48, (top + tall / 2) / 48, wide / 48, tall / 48]
        assert [float(value) for value in label[1:]] == pytest.approx(expected, abs=1e-6)
        assert label[0] == "0"
        assert each["snr"] > 0.0


def test_a_target_beside_the_frame_has_no_label(tmp_path):
    fast = ["--speed", "7000", "--every", "60"]
    assert main(["physics", "frame", *WORDS, *fast, "-o", str(tmp_path / "SET")]) == 0
    total = json.loads((tmp_path / "SET" / "annotations.json").read_text())
    assert [each["image_id"] for each in total["annotations"]] == [2]
    assert (tmp_path / "SET" / "labels" / "clip000_0000.txt").read_text() == ""
    assert matplotlib.image.imread(tmp_path / "SET" / "masks" / "clip000_0000.png").max() == 0.0


def test_without_astropy_clips_are_arrays(tmp_path, monkeypatch):
    monkeypatch.setattr("opir_bench.movie_files.find_spec", lambda _: None)
    assert main(["physics", "frame", *WORDS, "-o", str(tmp_path / "SET")]) == 0
    with np.load(tmp_path / "SET" / "clips" / "clip000.npz") as arrays:
        assert arrays["electrons"].shape == arrays["mask"].shape == (3, 48, 48)
        assert arrays["time_s"].tolist() == [0.0, 1.0, 2.0]


@pytest.mark.parametrize(
    ("words", "reported"),
    [
        (["--every", "0"], "give a time above 0"),
        (["--clips", "0"], "give at least 1"),
        (["--snr", "9,3"], "the smaller first"),
        (["--band", "LWIR"], "'LWIR' is not one of SWIR, MWIR"),
    ],
)
def test_impossible_movies_are_refused(words, reported, tmp_path, capsys):
    assert main(["physics", "frame", *WORDS, *words, "-o", str(tmp_path / "SET")]) != 0
    assert reported in capsys.readouterr().err
    assert not (tmp_path / "SET").exists()
