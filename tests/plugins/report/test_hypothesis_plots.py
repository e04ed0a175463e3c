"""The report of a run whose tracker weighs hypotheses: their probabilities over time, tables of
tracks and sources.
"""

from functools import cache

import numpy as np
import pytest
from attrs import evolve
from matplotlib.figure import Figure
from opir_report import RunPlots
from opir_report.pages.run_sections import identity_section
from opir_report.plots.hypotheses import hypothesis_history
from opir_report.run_facts import RunFacts, containment_rings
from opir_testing import stub_estimates, stub_regions
from reported_runs import empty_run, report_page
from two_sides import two_sides_plan

import opir_core as opir


@cache
def two_sides() -> opir.Run:
    return opir.run_of_plan(two_sides_plan())


def test_the_history_has_the_hypotheses_that_reach_one_percent() -> None:
    run = two_sides()
    data = hypothesis_history(RunFacts(run))
    rows = {
        (track, of, hypothesis, chance)
        for track, of, hypothesis, chance in zip(
            *(data[name].tolist() for name in ("track_id", "of", "hypothesis", "probability")),
            strict=True,
        )
    }
    assert rows == {
        (0, "T1 (ICBM)", "ICBM", 0.9),
        (0, "T1 (ICBM)", "none of these", 0.1),
        (1, "F-1 (fire)", "ground source", 0.998),
    }
    assert len(data) == 3 * len(np.unique(run.tracks.tick_s))


def test_the_plot_has_a_line_for_each_hypothesis_of_a_track() -> None:
    plots = RunPlots(two_sides())
    axes = Figure().add_subplot()
    plots.hypotheses(ax=axes)
    drawn = {line.get_ydata()[0] for line in axes.get_lines() if len(line.get_ydata())}
    assert (drawn, axes.get_title(loc="left") or axes.get_title()) == (
        {0.9, 0.1},
        "T1 (ICBM), track 0",
    )
    with pytest.raises(KeyError, match="no plot of the track 7; there are those of 0, 1"):
        plots.hypotheses(7)


def test_the_report_has_tables_of_tracks_and_of_sources() -> None:
    run = two_sides()
    section = identity_section(RunPlots(run))
    assert section is not None
    figure, tracks, sources = section.parts
    assert figure.name == "hypotheses"
    assert tracks.head[:3] == ("track", "likeliest", "P(launch)")
    assert [row[1:3] for row in tracks.rows] == [
        ("ICBM 0.90", "0.90"),
        ("ground source > 0.99", "< 0.01"),
    ]
    assert [row[-1] for row in tracks.rows] == ["-", "lost"]
    assert sources.rows[0][-2:] == ("1", "tracker: ground source > 0.99")
    assert any(line.startswith("T1 (ICBM): first seen by A") for line in report_page(run).summary)
    assert identity_section(RunPlots(empty_run())) is None


def test_maps_show_the_regions_of_the_likeliest_condition() -> None:
    burn_over = stub_regions(9.0, 167.7, 60.0, condition="burn over", probability=0.75)
    relights = stub_regions(9.0, 167.7, 400.0, condition="relights", probability=0.125)
    rings = containment_rings(stub_estimates(1, impact_regions=[(*burn_over, *relights)]), 0)
    assert [area for area, _ in rings.values()] == [region.area_km2 for region in burn_over]
    unknown = evolve(two_sides(), tracks=stub_estimates(1))
    assert len(hypothesis_history(RunFacts(unknown))) == 0
