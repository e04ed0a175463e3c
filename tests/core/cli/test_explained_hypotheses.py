"""`opir explain` lists what a hot object may be where a tracker or a classifier weighs it."""

from pathlib import Path

import pytest

import opir_core as opir
from opir_core.cli.main import main
from opir_core.plugin import GROUPS
from opir_core.simulation.explanation import explained

SCENE = "examples/first_light.yaml"


@pytest.mark.parametrize(
    ("changes", "by"),
    [
        ((), []),
        (("tracker=imm",), ["by_motion"]),
        (("detection=snr", "classification=paper"), []),
        (("detection=snr", "classification=spectral"), ["by_light"]),
        (("detection=snr", "tracker=imm"), ["by_motion", "by_light"]),
    ],
)
def test_hypotheses_are_listed_by_evidence(changes: tuple[str, ...], by: list[str]) -> None:
    """A tracker sees motion and no bands, a classifier bands and no motion: each is listed only
    where it is there.
    """
    plan = opir.compile_plan(opir.load_scene(SCENE, overrides=["outputs=[]", *changes]))
    rows = explained(plan)["hypotheses"]
    assert bool(rows) == bool(by)
    if by:
        assert [name for row in rows for name in row["hypotheses"]] == list(plan.hypothesis_names)
        assert [row["group"] for row in rows] == [
            group for group in GROUPS if any(row["group"] == group for row in rows)
        ]
        assert all([key for key in ("by_motion", "by_light") if row[key]] == by for row in rows)


def test_the_text_says_what_distinguishes_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert Path(SCENE).is_file()
    assert main(["explain", SCENE, "--tracker", "imm"]) == 0
    lines = capsys.readouterr().out.splitlines()
    start = next(place for place, line in enumerate(lines) if line.startswith("it may be "))
    assert lines[start].split("  ")[-1].strip() == "by its motion, to the tracker"
    assert not any("bands" in line for line in lines[start : start + 8])
    assert any(
        line.startswith("ground source ") and "stands still" in line for line in lines[start:]
    )
