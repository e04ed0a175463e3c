"""The settings of reporting latency: stages, presets, and what a scene may not say."""

import math

import pytest
from late_scene import late_scene

import opir_core as opir
from opir_core.plugin import ReportingStage
from opir_core.reading import scene_mapping
from opir_core.sensors.reporting import ReportingConfig, ReportingStageConfig


def stages_of(reporting: object) -> tuple[ReportingStage, ...]:
    """Return the stages of the sensor that a scene makes."""
    return opir.compile_plan(late_scene(reporting)).sensors[0].reporting


def test_reports_are_at_once_by_default() -> None:
    assert late_scene("none").sensors[0].model.config.reporting == ReportingConfig()
    assert stages_of("none") == stages_of({}) == ()


def test_stages_are_in_order_and_those_left_out_have_none() -> None:
    stages = stages_of({"processing": {"mean_s": 2.0, "sigma_s": 0.5}, "on_board": {"mean_s": 1}})
    reported = [(stage.name, stage.mean_s, stage.sigma_s) for stage in stages]
    assert reported == [("on_board", 1.0, 0.0), ("downlink", 0.0, 0.0), ("processing", 2.0, 0.5)]


def test_the_paper_s_ground_chain_has_the_moments_of_its_range() -> None:
    """A uniform distribution over [a, b] has the mean (a + b) / 2 and the standard deviation (b -
    a) / √12.
    """
    stages = stages_of("paper-ground-chain")
    assert sum(stage.mean_s for stage in stages) == (20.0 + 50.0) / 2.0
    assert math.hypot(*(stage.sigma_s for stage in stages)) == pytest.approx(
        (50.0 - 20.0) / math.sqrt(12.0)
    )


@pytest.mark.parametrize(
    "reporting", ["none", "paper-ground-chain", {"downlink": {"mean_s": 0.25}}]
)
def test_a_scene_s_canonical_form_writes_the_stages_out(reporting: object) -> None:
    scene = late_scene(reporting)
    written = scene_mapping(scene)
    assert set(written["sensors"][0]["reporting"]) == {"on_board", "downlink", "processing"}
    assert opir.scene_from_mapping(written) == scene


@pytest.mark.parametrize(
    ("reporting", "words"),
    [
        (
            "papr-ground-chain",
            "'papr-ground-chain' is not none or paper-ground-chain; or give a block of settings",
        ),
        (3.0, "a block of on_board, downlink, processing is needed"),
        (
            {"uplink": {"mean_s": 1.0}},
            "uplink: unknown key; known here: on_board, downlink, processing",
        ),
        ({"downlink": "none"}, "downlink: 'none' is text; a block of mean_s, sigma_s is needed"),
        ({"downlink": {"mean_s": -1.0}}, "downlink.mean_s: -1.0 is outside [0, 86400] s"),
        (
            {"downlink": {"mean_s": 1.0, "sigma_s": 10.5}},
            "sigma_s: 10.5 s is more than ten times mean_s, 1 s",
        ),
        ({"downlink": {"sigma_s": 1.0}}, "sigma_s: 1 s is more than ten times mean_s, 0 s"),
    ],
)
def test_an_invalid_latency_is_refused_with_its_place(reporting: object, words: str) -> None:
    with pytest.raises(opir.SceneError) as refused:
        late_scene(reporting)
    assert "sensors[0].reporting" in str(refused.value)
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"tracking_order": "arrival"},
            "tracking_order: 'arrival' is not one of observation, report",
        ),
        ({"tracking_lag_s": -1.0}, "tracking_lag_s: -1.0 is outside [0, 86400] s"),
    ],
)
def test_an_invalid_order_of_tracking_is_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(opir.SceneError, match="1 problem") as refused:
        late_scene("none", **changes)
    assert words in str(refused.value)


def test_a_stage_takes_ten_times_its_mean_as_its_largest_spread() -> None:
    assert ReportingStageConfig(mean_s=0.1, sigma_s=1.0).sigma_s == 1.0
    with pytest.raises(ValueError, match="ten times"):
        ReportingStageConfig(mean_s=0.1, sigma_s=1.01)
