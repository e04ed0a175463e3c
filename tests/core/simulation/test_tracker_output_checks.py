"""An invalid output of a tracker gives one message: the plugin, the method, what was wrong, and the
way out.
"""

import re

import numpy as np
import pytest
from attrs import evolve, frozen
from attrs.exceptions import FrozenInstanceError
from two_sensor_scene import two_sensor_scene

import opir_core as opir
from opir_core import run_of_plan
from opir_core.errors import ModelError
from opir_core.plugin import TrackerModel, Tracks, hookimpl, text
from opir_core.scene import core_hypotheses

SCENE = two_sensor_scene(duration_s=15.0)


def fail(*_):
    raise KeyError("no such thing")


def reported(tick_s, **changes):
    unknown = np.full((2, 7, 7), np.nan)
    tracks = Tracks(
        tick_s=np.full(2, tick_s),
        track=np.arange(2),
        state=unknown[:, 0, :6],
        state_covariance=unknown[:, :6, :6],
        launch=unknown[:, 0, :3],
        launch_covariance=unknown[:, :3, :3],
        impact=unknown[:, 0, :3],
        impact_covariance=unknown[:, :3, :3],
        type_probability=unknown[:, 0, :4],
    )
    return evolve(tracks, **changes)


#: The number of hypotheses of a host without plugins.
HYPOTHESES = len(core_hypotheses())
WEIGHED = np.full((2, HYPOTHESES), 1.0 / HYPOTHESES)

#: What a method answers instead, and the words that it is reported in.
FAULTS = {
    "associate": [
        (
            fail,
            (
                "associate raised KeyError: 'no such thing' (simulation/test_tracker_output_checks.py,"
                " line"
            ),
        ),
        (lambda _: None, "associate returned None for 4 detections"),
        (lambda found: np.zeros(len(found)), "associate returned float64 (4,) for 4 detections"),
        (
            lambda found: np.zeros(len(found) + 1, dtype=np.int64),
            "associate returned int64 (5,) for 4 detections",
        ),
        (lambda found: np.full(len(found), -2), "associate returned the track -2"),
    ],
    "step": [
        (
            fail,
            (
                "step at 1 s raised KeyError: 'no such thing'"
                " (simulation/test_tracker_output_checks.py, line"
            ),
        ),
        (lambda *_: None, "step at 1 s returned None, no opir_core.interfaces.records.Tracks"),
        (lambda *_: [], "step at 1 s returned a list, no opir_core.interfaces.records.Tracks"),
        (
            lambda tick_s, _: reported(tick_s, track=np.array([1, 0])),
            "step at 1 s returned tracks numbered [1, 0]",
        ),
        (
            lambda tick_s, _: reported(tick_s, track=np.array([1, 1])),
            "step at 1 s returned tracks numbered [1, 1]",
        ),
        (
            lambda tick_s, _: reported(tick_s, track=np.array([-1, 1])),
            "step at 1 s returned tracks numbered [-1, 1]",
        ),
        (
            lambda tick_s, _: reported(tick_s, state=np.zeros((2, 3))),
            "step at 1 s returned state as float64 (2, 3), not 2 rows",
        ),
        (
            lambda tick_s, _: reported(tick_s, impact=np.zeros((3, 3))),
            "step at 1 s returned impact as float64 (3, 3), not 2",
        ),
        (
            lambda tick_s, _: reported(tick_s, launch=None),
            "step at 1 s returned launch as None, not 2 rows of shape (3,)",
        ),
        (
            lambda tick_s, _: reported(tick_s + 5.0),
            "step at 1 s returned tick_s 6, not that of the step",
        ),
        (
            lambda tick_s, _: reported(tick_s, impact_regions=np.zeros(2)),
            (
                "step at 1 s returned impact_regions as float64 (2,), not 2 tuples of"
                " opir_core.ImpactRegion"
            ),
        ),
        (
            lambda tick_s, _: reported(tick_s, impact_regions=np.array([None, ()], dtype=object)),
            "step at 1 s returned impact_regions that are not tuples of opir_core.ImpactRegion",
        ),
        (
            lambda tick_s, _: reported(tick_s, impact_regions=np.array([(), (3,)], dtype=object)),
            "step at 1 s returned impact_regions that are not tuples of opir_core.ImpactRegion",
        ),
        (
            lambda tick_s, _: reported(tick_s, impact_method=np.array([0, 2], dtype=np.uint8)),
            "step at 1 s returned impact_method [0, 2], not codes into ('posterior', 'paper')",
        ),
        (
            lambda tick_s, _: reported(tick_s, end=np.array([0, 9], dtype=np.uint8)),
            (
                "step at 1 s returned end [0, 9], not codes into ('', 'impact', 'orbit', 'lost',"
                " 'flash', 'unresolved')"
            ),
        ),
        (
            lambda tick_s, _: reported(tick_s, hypothesis_probability=np.ones((2, 2))),
            "step at 1 s returned hypothesis_probability as float64 (2, 2), not 2 rows of shape",
        ),
        (
            lambda tick_s, _: reported(
                tick_s, hypothesis_probability=np.full((2, HYPOTHESES), 0.5 / HYPOTHESES)
            ),
            "step at 1 s returned hypothesis_probability that sums to [0.5, 0.5], not to 1",
        ),
        (
            lambda tick_s, _: reported(tick_s, probability_launch=np.array([0.5, 1.5])),
            "step at 1 s returned probability_launch outside [0, 1]",
        ),
        (
            lambda tick_s, _: reported(
                tick_s, **({"hypothesis_probability": WEIGHED} if tick_s > 1.0 else {})
            ),
            f"step at 2 s returned {HYPOTHESES} hypotheses, after 0 at earlier ticks",
        ),
    ],
    "cadence_s": [
        (0.0, "cadence_s is 0.0, neither"),
        ("2", "cadence_s is '2', neither"),
        (float("nan"), "cadence_s is nan, neither"),
    ],
}


class Sound:
    """A tracker with valid outputs: two tracks without estimates."""

    cadence_s = 1.0

    def associate(self, detections):
        return np.full(len(detections), -1, dtype=np.int64)

    def step(self, tick_s, detections):
        return reported(tick_s)


def host_of(build):
    @frozen(kw_only=True)
    class Config:
        name: str = text(default="x", help="a name")

    class Plugin:
        @hookimpl
        def opir_trackers(self):
            yield TrackerModel(name="frail", summary="a tracker", config=Config, build=build)

    return opir.Host.of(Plugin())


def complaint_of(build):
    host = host_of(build)
    with pytest.raises(ModelError) as raised:
        opir.simulate(opir.scene_from_mapping({**SCENE, "tracker": "frail"}, host=host), host)
    return str(raised.value)


def broken(method, answer):
    tracker = Sound()
    setattr(tracker, method, answer)
    return tracker


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "answer", "words"),
    [(method, *fault) for method, faults in FAULTS.items() for fault in faults],
)
def test_invalid_tracks_are_reported_with_owner_and_remedy(method, answer, words):
    complaint = complaint_of(lambda *_: broken(method, answer))
    assert complaint.startswith(
        f"tracker: the tracker 'frail' of plugin Plugin (registered by this program): {words}"
    )
    assert complaint.endswith("; `opir check frail` shows what is required")
    assert "\n" not in complaint


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (
            fail,
            r"build raised KeyError: 'no such thing' \(simulation/test_tracker_output_checks.py, line \d+\)",
        ),
        (
            lambda *_: None,
            r"build made None without associate\(detections\) and step\(tick_s, detections\);",
        ),
        (lambda *_: object(), r"build made an object without associate\(detections\) and step"),
    ],
)
def test_what_cannot_be_built_is_reported_with_whose_it_is(build, words):
    assert re.search(words, complaint_of(build))


def test_the_line_reported_is_the_trackers_and_no_librarys():
    def unsolvable(*_):
        return np.linalg.solve(np.zeros((2, 2)), np.zeros(2))

    complaint = complaint_of(lambda *_: broken("step", unsolvable))
    assert (
        "step at 1 s raised LinAlgError: Singular matrix (simulation/test_tracker_output_checks.py,"
        " line " in complaint
    )


def test_the_innermost_line_of_the_plugin_is_reported(monkeypatch):
    monkeypatch.setattr("opir_trackers.imm.associate.unassigned", np.linalg.inv)
    with pytest.raises(
        ModelError, match=r"of opir-trackers .*LinAlgError: .* \(imm/associate.py, line \d+\)"
    ):
        opir.simulate(opir.scene_from_mapping({**SCENE, "tracker": "imm"}))


@pytest.mark.parametrize("weighed", [np.empty((2, 0)), WEIGHED, np.nan * WEIGHED])
def test_a_sound_tracker_runs(weighed):
    host = host_of(
        lambda *_: broken(
            "step", lambda tick_s, _: reported(tick_s, hypothesis_probability=weighed)
        )
    )
    run = opir.simulate(opir.scene_from_mapping({**SCENE, "tracker": "frail"}, host=host), host)
    assert len(run.tracks) == 2 * 15


def test_opirs_own_errors_go_through():
    def refuse(*_):
        raise ModelError("in words of its own")

    assert complaint_of(lambda *_: broken("step", refuse)) == "in words of its own"


@pytest.mark.slow
@pytest.mark.parametrize("tracker", ["imm", "kepler-arc"])
def test_a_plan_run_twice_gives_the_same_run_twice(tracker):
    plan = opir.compile_plan(opir.scene_from_mapping({**SCENE, "tracker": tracker}))
    first_value, second, third = (run_of_plan(plan, window_s) for window_s in (None, 0.7, 4.0))
    assert len(first_value.tracks) > 5
    for second_run in (second, third):
        assert np.array_equal(first_value.tracks.tick_s, second_run.tracks.tick_s)
        assert np.array_equal(first_value.tracks.state, second_run.tracks.state, equal_nan=True)
        assert np.array_equal(first_value.detections.track, second_run.detections.track)


def test_a_plan_makes_a_tracker_of_its_users_anew_for_each_run():
    built = []
    plan = evolve(
        opir.compile_plan(opir.scene_from_mapping({**SCENE, "tracker": "none"})),
        make_tracker=lambda: built.append(Sound()) or built[-1],
    )
    for count in (1, 2):
        assert len(run_of_plan(plan).tracks)
        assert len(built) == count
    with pytest.raises(FrozenInstanceError):
        plan.make_tracker = Sound
