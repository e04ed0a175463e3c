"""
Who sees a launch, and how soon
===============================

The time to the first report of launches from everywhere, with two constellations. `opir coverage
SCENE -o FOLDER` writes a page with this and some forty other layers, and their data.
"""

from opir_coverage import CoverageSettings, computed_coverage, layer_axes

import opir_core as opir

changes = ["sensors=[{constellation: SBIRS-GEO}, {constellation: HEO-MOLNIYA}]"]
scene = opir.load_scene("../arctic_watch.yaml", overrides=changes)
settings = CoverageSettings(
    target_class="SRBM", grid_deg=5.0, steps=24, heights_km=(10.0,), launches=1
)
found = computed_coverage(scene, settings)
layer_axes(found, "first_report")

# %%
# The least number of sensors in view over the day, of targets at 10 km.

layer_axes(found, "in_view_min")
