"""A launch and a fire, followed by a tracker that weighs hypotheses."""

from typing import Any

import numpy as np
from opir_testing.doubles import stub_estimates

import opir_core as opir
from opir_core.planning.plan import compile_plan
from opir_core.plugin import Host, NoConfig, Tracker, TrackerModel, hookimpl


class TwoSides(Tracker):
    """A track for what is north of the equator, an ICBM with 0.9, and one for what is south, a
    fire, which is lost.
    """

    cadence_s = 1.0

    def __init__(self, hypotheses):
        self._hypotheses = hypotheses

    def associate(self, detections):
        return np.where(detections.line_of_sight_ecef[:, 2] > 0.0, 0, 1).astype(np.int64)

    def step(self, tick_s, detections):
        names = [hypothesis.name for hypothesis in self._hypotheses]
        sides = {"ICBM": 0.9, "none of these": 0.1}, {"ground source": 0.998, "SRBM": 0.002}
        chances = np.array([[side.get(name, 0.0) for name in names] for side in sides])
        place = np.radians([[34.7, -120.6, 0.0], [-20.0, -80.0, 0.0]])
        weighed = {
            "hypothesis_probability": chances,
            "end": [0, 3 if tick_s == SCENE["duration_s"] else 0],
        }
        return stub_estimates(
            2, self._hypotheses, tick_s=tick_s, track=np.arange(2), launch=place, **weighed
        )


class TwoSidesPlugin:
    @hookimpl
    def opir_trackers(self):
        yield TrackerModel(
            name="two-sides",
            summary="north and south",
            config=NoConfig,
            build=lambda _config, context: TwoSides(context.hypotheses),
        )


SCENE: dict[str, Any] = {
    "scene": "a launch and a fire",
    "epoch": "2026-04-01T03:00:00Z",
    "duration_s": 60.0,
    "seed": 3,
    "sensors": [{"model": "generic-scanner", "id": "A", "orbital_slot_deg": -100.0}],
    "targets": [
        {
            "id": "T1",
            "type": "ICBM",
            "launch": {"lat_deg": 34.7, "lon_deg": -120.6, "time_s": 0.0},
            "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
        }
    ],
    "sources": [{"id": "F", "model": "fires", "at": [{"lat_deg": -20.0, "lon_deg": -80.0}]}],
    "detection": "snr",
    "tracker": "two-sides",
}


def two_sides_host():
    """Return a host of what is installed and the tracker."""
    host = Host.discover()
    host.register(TwoSidesPlugin())
    return host


def two_sides_plan(**changes):
    """Return the plan of the scene with changes."""
    host = two_sides_host()
    return compile_plan(opir.scene_from_mapping({**SCENE, **changes}, host=host), host)
