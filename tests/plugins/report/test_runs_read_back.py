"""Any run has the same scores, report and plots from memory as from the files that it wrote."""

import json
import math
import re
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
from attrs import evolve
from hypothesis import given, settings, strategies as st
from opir_scoring import evidence_of_files, evidence_of_run, scorecard
from random_scenes import TRACKERS, sensors, targets, tracked_scene
from reported_runs import report_page
from written_regions import as_written

import opir_core as opir
from examples import examples
from opir_core.cli.main import main

#: Events have angles to 1e-9 degrees and standard deviations to a few digits.
RELATIVE = 2e-3

#: A figure in words has two digits and may be at an edge of its rounding.
RELATIVE_IN_WORDS = 0.06
NUMBER = re.compile(r"\d+(?: \d{3})*(?:\.\d+)?")
#: Where a wide region lies is said by steps of five degrees, or not at all beyond a half circle:
#: a region at the edge of either may be said otherwise.
REACH = re.compile(r"somewhere .*? km away(?:, bearing \d+ to \d+ deg)?")


def words_alike(text: str, other_text: str) -> bool:
    """Return whether two sentences have the same words, and numbers that round to each other."""
    text = REACH.sub("somewhere", text)
    other_text = REACH.sub("somewhere", other_text)
    return NUMBER.sub("#", text) == NUMBER.sub("#", other_text) and all(
        math.isclose(
            float(one.replace(" ", "")),
            float(other.replace(" ", "")),
            rel_tol=RELATIVE_IN_WORDS,
            abs_tol=0.011,
        )
        for one, other in zip(NUMBER.findall(text), NUMBER.findall(other_text), strict=True)
    )


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


def log_probability(p_value: Any) -> Any:
    """Return the logarithm of a test's p-value, which falls with the square of a distance: an error
    of the distance is magnified in p by about twice its logarithm.
    """
    is_tail = isinstance(p_value, float) and 0.0 < p_value < 1.0
    return math.log(p_value) if is_tail else p_value


def differences(value: Any, other_value: Any, path: str, floor: float = 1e-6) -> list[str]:
    """Return the paths of what two plain values differ by."""
    if isinstance(value, dict) and isinstance(other_value, dict):
        keys = [f"{path}.{key}: in one alone" for key in value.keys() ^ other_value.keys()]
        return keys + [
            d
            for key in value.keys() & other_value.keys()
            for d in differences(value[key], other_value[key], f"{path}.{key}")
        ]
    if path.endswith(".interval_95"):
        value = scaled_interval(value)
        other_value = scaled_interval(other_value)
    if path.endswith(".distribution_p"):
        value = log_probability(value)
        other_value = log_probability(other_value)
    if isinstance(value, str) and isinstance(other_value, str):
        same_words = words_alike(value, other_value)
        return [] if same_words else [f"{path}: {value!r} and {other_value!r}"]
    if isinstance(value, list | tuple) and isinstance(other_value, list | tuple):
        if len(value) != len(other_value):
            return [f"{path}: {len(value)} and {len(other_value)} values"]
        return [
            d
            for k, pair in enumerate(zip(value, other_value, strict=True))
            for d in differences(*pair, f"{path}[{k}]")
        ]
    if isinstance(value, float) and isinstance(other_value, float | int):
        is_same = math.isclose(value, other_value, rel_tol=RELATIVE, abs_tol=floor) or (
            math.isnan(value) and math.isnan(other_value)
        )
    else:
        is_same = value == other_value
    return [] if is_same else [f"{path}: {value!r} and {other_value!r}"]


def figures_of(run: Any) -> dict[str, Any]:
    """Return the data of all figures of a run's report, its tables and its sentences, as plain
    values.
    """
    page = report_page(run)
    data = {
        figure.name: {
            name: np.asarray(column).tolist() for name, column in figure.data.columns.items()
        }
        for figure in page.figures()
        if figure.data is not None
    }
    tables = {table.caption: [list(row) for row in table.rows] for table in page.tables()}
    captions = {figure.name: figure.caption for figure in page.figures()}
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
        # Outlines are written with fewer points: scores and distances of regions depend on them.
        written = evolve(run, tracks=run.tracks.replaced(impact_regions=as_written(run)))
        cards = [
            scorecard([evidence_of_run(written, run.plan)]).as_plain(),
            scorecard([evidence_of_files(events)]).as_plain(),
        ]
        assert not differences(*cards, "score")
        assert not differences(figures_of(written), figures_of(opir.load_run(events)), "report")
