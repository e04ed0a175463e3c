"""`opir explain` lists what a hot object may be where a tracker or a classifier weighs it."""

from pathlib import Path

import pytest

import opir_core as opir
from opir_core.cli.main import main
from opir_core.scene.hypotheses import GROUPS
from opir_core.simulation.explanation import explained

SCENE = "examples/first_light.yaml"


@pytest.mark.parametrize(
    ("changes", "is_listed"),
    [
        ((), False),
        (("tracker=imm",), True),
        (("detection=snr", "classification=paper"), False),
        (("detection=snr", "classification=spectral"), True),
    ],
)
def test_hypotheses_are_listed_if_something_weighs_them(changes: tuple[str, ...], is_listed: bool) -> None:
    plan = opir.compile_plan(opir.load_scene(SCENE, overrides=["outputs=[]", *changes]))
    rows = explained(plan)["hypotheses"]
    assert bool(rows) == is_listed
    if is_listed:
        assert [name for row in rows for name in row["hypotheses"]] == list(plan.hypothesis_names)
        assert [row["group"] for row in rows] == [
            group for group in GROUPS if any(row["group"] == group for row in rows)
        ]
        assert len({row["distinguished_by"] for row in rows}) == len(rows)


def test_the_text_says_what_distinguishes_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert Path(SCENE).is_file()
    assert main(["explain", SCENE, "--tracker", "imm"]) == 0
    lines = capsys.readouterr().out.splitlines()
    start = next(place for place, line in enumerate(lines) if line.startswith("it may be "))
    assert lines[start].split("  ")[-1].strip() == "what distinguishes it"
    assert any(line.startswith("ground source ") and "stands still" in line for line in lines[start:])
