"""`reported_types: classes`: reports name target classes, trackers keep the four types of the
paper.
"""

import json

import numpy as np
import opir_forecast.plugin as forecast
import opir_photons.radiometry.plugin as light
import pytest
from opir_testing.bench import bench_run, bench_scene
from opir_testing.json_schema import schema_errors
from opir_trackers import plugin as trackers

from opir_core import compile_plan, run_of_plan, simulate
from opir_core.errors import SceneError
from opir_core.output import detection_schema
from opir_core.plugin import REPORTED_TYPES, Host
from opir_core.reading import scene_from_mapping, scene_mapping
from opir_core.scene import core_target_classes

HOST = Host.of(trackers, forecast, light)
LAUNCH = {"lat_deg": 34.7, "lon_deg": -120.6, "time_s": 2.0}
MRBM = {"id": "M", "type": "MRBM", "launch": LAUNCH, "aim": {"lat_deg": 32.0, "lon_deg": -141.0}}
SLV = {"id": "S", "type": "SLV", "launch": LAUNCH, "azimuth_deg": 190.0}
ICBM = {"id": "I", "type": "ICBM", "launch": LAUNCH, "aim": {"lat_deg": 9.0, "lon_deg": 167.7}}
SENSOR = {"model": "generic-scanner", "orbital_slot_deg": -100.0, "scan_period_ms": 500.0}
FINE = {"MRBM": {"MRBM": 0.6, "IRBM": 0.3, "UNKNOWN": 0.1}, "SLV": {"SLV": 1.0}}


def sensors(confusion=FINE):
    return [
        {**SENSOR, "id": "A", "confusion": confusion},
        {**SENSOR, "id": "B", "orbital_slot_deg": -140.0, "confusion": confusion},
    ]


def scene(*targets, reports="classes", **changes):
    mapping = bench_scene(
        targets=list(targets), **{"sensors": sensors(), "reported_types": reports, **changes}
    )
    return scene_from_mapping(mapping, host=HOST)


def reported(run):
    return {run.reported_types[code] for code in run.detections.reported_type.tolist()}


def test_the_types_are_the_four_and_then_the_classes_by_name():
    plan = compile_plan(scene(ICBM), HOST)
    assert plan.reported_types[:4] == REPORTED_TYPES
    assert plan.reported_types[4:] == tuple(
        sorted(set(core_target_classes()) - set(REPORTED_TYPES))
    )
    assert compile_plan(scene(ICBM, reports="paper"), HOST).reported_types == REPORTED_TYPES


def test_the_setting_is_read_written_and_checked():
    read = scene(ICBM)
    assert scene_mapping(read)["reported_types"] == "classes"
    assert scene_from_mapping(scene_mapping(read), host=HOST) == read
    with pytest.raises(SceneError, match="reported_types: 'fine' is not one of paper, classes"):
        scene(ICBM, reports="fine")


def test_perfect_classifiers_report_classes_on_request():
    for reports, expected in (
        ("classes", {"MRBM", "SLV", "ICBM"}),
        ("paper", {"IRBM", "UNKNOWN", "ICBM"}),
    ):
        assert (
            reported(
                simulate(scene(MRBM, SLV, ICBM, reports=reports, classification="always"), HOST)
            )
            == expected
        )


def test_shares_of_reports_are_those_of_the_matrix():
    """Sixty sensors draw once each: the class's column with 0.6, in the 99.9 % interval of the
    binomial.
    """
    launches = [
        {**SENSOR, "id": f"S{k}", "orbital_slot_deg": -130.0 + k, "confusion": FINE}
        for k in range(60)
    ]
    run = simulate(scene(MRBM, sensors=launches, detection="always", duration_s=10.0), HOST)
    first_row = np.unique(run.detections.sensor, return_index=True)[1]
    assert len(first_row) == 60
    names = [run.reported_types[code] for code in run.detections.reported_type[first_row].tolist()]
    assert set(names) <= {"MRBM", "IRBM", "UNKNOWN"}
    assert 23 <= names.count("MRBM") <= 48


def test_class_columns_add_up_to_four_types():
    confusion = {"MRBM": {"MRBM": 0.5, "IRBM": 0.5}, "SLV": {"SLV": 1.0}}
    run = simulate(scene(MRBM, SLV, reports="paper", sensors=sensors(confusion)), HOST)
    assert reported(run) == {"IRBM", "UNKNOWN"}


def test_a_class_without_a_row_is_reported_as_it_resembles():
    certain = {"IRBM": {"IRBM": 1.0}}
    assert reported(simulate(scene(MRBM, sensors=sensors(certain)), HOST)) == {"IRBM"}


def test_sources_stay_unknown():
    fires = {"id": "fires", "model": "fires", "at": [{"lat_deg": 34.0, "lon_deg": -115.0}]}
    mapping = bench_scene(
        targets=[],
        sources=[fires],
        sensors=sensors(),
        reported_types="classes",
        detection="always",
        duration_s=5.0,
    )
    run = simulate(scene_from_mapping(mapping, host=HOST), HOST)
    assert len(run.detections) > 5
    assert reported(run) == {"UNKNOWN"}


def test_columns_that_name_no_class_are_refused():
    with pytest.raises(
        SceneError, match=r"sensors\[0\].confusion.ICBM.IBCM: no target class is named 'IBCM'"
    ):
        scene(ICBM, sensors=sensors({"ICBM": {"IBCM": 1.0}}))


def test_events_and_summaries_have_the_names_and_obey_the_schema():
    mapping = bench_scene(
        targets=[MRBM, SLV],
        sensors=sensors(),
        reported_types="classes",
        classification="always",
        duration_s=20.0,
    )
    lines = bench_run(mapping, HOST).lines
    assert {json.loads(line)["target_type"] for line in lines} == {"MRBM", "SLV"}
    schema = detection_schema()
    assert not [error for line in lines[:50] for error in schema_errors(json.loads(line), schema)]
    rows = simulate(scene_from_mapping(mapping, host=HOST), HOST).summary["targets"]
    assert [row["reported_type"] for row in rows] == ["MRBM", "SLV"]


@pytest.mark.slow
@pytest.mark.parametrize("order", ["observation", "report"])
@pytest.mark.parametrize("tracker", ["imm"])
def test_trackers_see_the_four_types(tracker, order):
    """A scene whose fine reports stand for the four types has the tracks of the scene that reports
    those.
    """
    fine = {
        "ICBM": {"SLBM": 1.0},
        "IRBM": {"IRBM": 1.0},
        "SRBM": {"SRBM": 1.0},
        "MRBM": {"MRBM": 1.0},
    }
    coarse = {
        "ICBM": {"ICBM": 1.0},
        "IRBM": {"IRBM": 1.0},
        "SRBM": {"SRBM": 1.0},
        "MRBM": {"IRBM": 1.0},
    }
    runs = [
        run_of_plan(
            compile_plan(
                scene(
                    ICBM,
                    MRBM,
                    reports=reports,
                    sensors=sensors(matrix),
                    tracker=tracker,
                    tracking_order=order,
                    duration_s=45.0,
                ),
                HOST,
            )
        )
        for reports, matrix in (("classes", fine), ("paper", coarse))
    ]
    assert reported(runs[0]) == {"SLBM", "MRBM"}
    assert reported(runs[1]) == {"ICBM", "IRBM"}
    assert len(runs[0].tracks) > 20
    for column in ("track", "state", "type_probability", "impact"):
        actual, expected = (getattr(run.tracks, column) for run in runs)
        assert actual.tobytes() == expected.tobytes()
    assert runs[0].detections.track.tobytes() == runs[1].detections.track.tobytes()


def test_scenes_of_the_four_types_keep_their_bytes():
    assert (
        bench_run(bench_scene(reported_types="classes"), HOST).lines
        == bench_run(bench_scene(), HOST).lines
    )
