"""Times to the first report of a map against detections of whole simulated runs of the same
launches.
"""

import numpy as np
import pytest
from opir_coverage import CoverageSettings, computed_coverage

from opir_core import scene_from_mapping, simulate
from opir_core.scene import core_target_class

BASE = {
    "scene": "first-reports",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 120.0,
    "seed": 1,
    "detection": "snr",
    "atmosphere": "lowtran",
    "sensors": [{"constellation": "SBIRS-GEO"}],
}


@pytest.mark.slow
def test_the_median_of_a_cell_is_that_of_simulated_runs():
    """A launch that is seen low over the horizon, and one from above; to 2 s, for simulated flights
    are aimed.
    """
    settings = CoverageSettings(
        target_class="SRBM",
        grid_deg=5.0,
        steps=1,
        hours=1e-4,
        heights_km=(10.0,),
        launches=1,
        chance=0.5,
        samples=40,
    )
    result = computed_coverage(scene_from_mapping({**BASE, "targets": []}), settings)
    first_s = np.asarray(result["first_report"].values)[0, 0]
    reach_deg = core_target_class("SRBM").profiles[0].reference_range_m / 111_200.0
    for latitude, longitude in ((-32.5, 12.5), (2.5, 12.5)):
        launch = {"lat_deg": latitude, "lon_deg": longitude, "time_s": 0.0}
        aim = {"lat_deg": latitude + reach_deg, "lon_deg": longitude}
        target = {"id": "T", "type": "SRBM", "launch": launch, "aim": aim}
        runs = [
            simulate(scene_from_mapping({**BASE, "seed": seed, "targets": [target]}))
            for seed in range(2, 18, 2)
        ]
        simulated_s = np.median([run.detections.time_s.min() for run in runs])
        place = int((latitude + 90.0) // 5.0), int((longitude + 180.0) // 5.0)
        assert first_s[place] == pytest.approx(simulated_s, abs=2.0)
