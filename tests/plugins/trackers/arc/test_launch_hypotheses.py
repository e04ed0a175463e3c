"""What `kepler-arc` says of a track: whether it is a launch by its motion, what was launched by its
arc.
"""

import numpy as np
import pytest
from opir_trackers.arc.launch_hypotheses import LaunchHypotheses

import opir_core as opir
from opir_core.plugin import REPORTED_TYPES
from opir_core.scene import core_hypotheses

HYPOTHESES = core_hypotheses()
LAUNCHES = LaunchHypotheses.of(HYPOTHESES)
#: The rates of launches do not say which: without an arc, and of what an arc cannot tell, this is
#: all that is known.
(PRIOR,) = LAUNCHES.given_launch(np.array([[0.0, 0.0, 0.0, 1.0]]), np.array([False]))


def mass(chances, **wanted):
    """Return the sum of the probabilities (H,) of hypotheses with these attributes."""
    mine = [
        all(getattr(one, name) == value for name, value in wanted.items()) for one in HYPOTHESES
    ]
    return chances[np.array(mine)].sum()


def given(*types, in_orbit=False):
    return LAUNCHES.given_launch(np.array([types]), np.array([in_orbit]))[0]


@pytest.mark.parametrize("code", range(3))
def test_a_range_tells_missiles_apart_and_nothing_else(code):
    found = given(*np.eye(4)[code])
    assert found.sum() == pytest.approx(1.0)
    for group in ("missile", "orbit", "glide", "none"):
        assert mass(found, group=group) == pytest.approx(mass(PRIOR, group=group))
    assert mass(found, group="missile", reported_type=REPORTED_TYPES[code]) == pytest.approx(
        mass(PRIOR, group="missile")
    )


def test_a_range_between_two_types_is_shared_by_both():
    assert given(0.25, 0.75, 0.0, 0.0) == pytest.approx(
        0.25 * given(1, 0, 0, 0) + 0.75 * given(0, 1, 0, 0)
    )


def test_what_does_not_come_down_is_no_missile():
    found = given(0.0, 0.0, 0.0, 1.0, in_orbit=True)
    assert found.sum() == pytest.approx(1.0)
    assert mass(found, group="missile") == 0.0
    orbit = mass(PRIOR, group="orbit")
    assert mass(found, group="orbit") == pytest.approx(orbit / (orbit + mass(PRIOR, group="none")))


@pytest.mark.slow
def test_a_fire_is_no_launch_and_a_launch_among_fires_is_found():
    fires = [{"lat_deg": 33.5, "lon_deg": 55.2}, {"lat_deg": 36.0, "lon_deg": 52.0}]
    launch = {"lat_deg": 33.0, "lon_deg": 55.0, "time_s": 5.0}
    blocks = {
        "scene": "fires",
        "epoch": "2026-04-01T03:00:00Z",
        "duration_s": 60,
        "seed": 4,
        "sensors": [
            {"model": "SBIRS-GEO", "id": "S1", "orbital_slot_deg": 40.0},
            {"model": "SBIRS-GEO", "id": "S2", "orbital_slot_deg": 90.0},
        ],
        "targets": [
            {
                "id": "T1",
                "type": "SRBM",
                "launch": launch,
                "aim": {"lat_deg": 36.5, "lon_deg": 55.0},
            }
        ],
        "detection": "snr",
        "background": "earth",
        "tracker": "kepler-arc",
        "sources": [{"id": "fires", "model": "fires", "at": fires}],
    }
    run = opir.simulate(opir.scene_from_mapping(blocks))
    rows = run.summary["tracks"]
    assert sorted(row["likeliest_hypothesis"] for row in rows) == [
        "SRBM",
        "ground source",
        "ground source",
    ]
    for row in rows:
        mine = run.tracks.take(np.flatnonzero(run.tracks.track == row["track_id"]))
        np.testing.assert_allclose(mine.hypothesis_probability.sum(axis=1), 1.0)
        if row["likeliest_hypothesis"] == "SRBM":
            assert row["launch"] is not None
            assert row["impact"] is not None
        else:
            assert mine.probability_launch.max() < 0.05
            assert np.isnan(mine.launch).all()
            assert np.isnan(mine.impact).all()
