"""Any run has the same scores, report and plots from memory as from the files that it wrote."""

import json
import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from opir_report.pages.run_report import run_page
from opir_scoring import evidence_of_run, scorecard
from opir_scoring.evidence import evidence_of_files
from random_scenes import TRACKERS, sensors, targets, tracked_scene

import opir_core as opir
from examples import examples
from opir_core.cli.main import main

#: Events have angles to 1e-9 degrees and standard deviations to a few digits.
RELATIVE = 2e-3


def scaled_interval(ends: list[Any]) -> list[Any]:
    """Return the ends of a positive interval as powers that shrink with its width, else as they
    are.

    The ends of an interval of a logarithm magnify a rounding by about the logarithm of their ratio.
    """
    low, high = ends
    if not (isinstance(low, float) and isinstance(high, float) and 0.0 < low < high < math.inf):
        return ends
    power = 1.0 / max(1.0, math.log(high / low))
    return [low**power, high**power]


def differences(ours: Any, theirs: Any, where: str, floor: float = 1e-6) -> list[str]:
    """Return the paths of what two plain values differ by."""
    if isinstance(ours, dict) and isinstance(theirs, dict):
        keys = [f"{where}.{key}: in one alone" for key in ours.keys() ^ theirs.keys()]
        return keys + [
            d
            for key in ours.keys() & theirs.keys()
            for d in differences(ours[key], theirs[key], f"{where}.{key}")
        ]
    if where.endswith(".interval_95"):
        ours = scaled_interval(ours)
        theirs = scaled_interval(theirs)
    if isinstance(ours, list | tuple) and isinstance(theirs, list | tuple):
        if len(ours) != len(theirs):
            return [f"{where}: {len(ours)} and {len(theirs)} values"]
        return [
            d
            for k, pair in enumerate(zip(ours, theirs, strict=True))
            for d in differences(*pair, f"{where}[{k}]")
        ]
    if isinstance(ours, float) and isinstance(theirs, float | int):
        is_same = math.isclose(ours, theirs, rel_tol=RELATIVE, abs_tol=floor) or (
            math.isnan(ours) and math.isnan(theirs)
        )
    else:
        is_same = ours == theirs
    return [] if is_same else [f"{where}: {ours!r} and {theirs!r}"]


def figures_of(run: Any) -> dict[str, Any]:
    """Return the data of all figures of a run's report, its tables and its sentences, as plain
    values.
    """
    page = run_page(run)
    data = {
        each.name: {name: np.asarray(column).tolist() for name, column in each.data.columns.items()}
        for each in page.figures()
        if each.data is not None
    }
    tables = {each.caption: [list(row) for row in each.rows] for each in page.tables()}
    captions = {each.name: each.caption for each in page.figures()}
    return {
        "data": data,
        "tables": tables,
        "captions": captions,
        "summary": list(page.summary),
        "head": page.subtitle,
    }


@pytest.mark.slow
@settings(examples(4), derandomize=True)
@given(
    sensors=sensors(),
    targets=targets(),
    tracker=st.sampled_from(TRACKERS),
    seed=st.integers(0, 1000),
)
def test_a_run_read_back_is_scored_and_reported_alike(
    sensors: list[dict[str, Any]], targets: list[dict[str, Any]], tracker: Any, seed: int
) -> None:
    with TemporaryDirectory() as folder:
        events = Path(folder) / "events.jsonl"
        path = Path(folder) / "scene.yaml"
        outputs = [{"jsonl": {"path": str(events)}}]
        scene = {**tracked_scene(sensors, targets, tracker, seed), "outputs": outputs}
        path.write_text(json.dumps(scene))
        assert main(["run", str(path), "--quiet"]) == 0
        run = opir.simulate(opir.scene_from_mapping(scene))
        cards = [
            scorecard([evidence_of_run(run, run.plan)]).as_plain(),
            scorecard([evidence_of_files(events)]).as_plain(),
        ]
        assert not differences(*cards, "score")
        assert not differences(figures_of(run), figures_of(opir.load_run(events)), "report")
