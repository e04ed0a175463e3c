"""Impact regions with the outlines that files have: few points, within 1 % of the radius."""

import json
from typing import Any

import numpy as np

import opir_core
from opir_core.output.geojson import region_from_document, region_text


def as_written(run: opir_core.Run) -> Any:
    """Return the regions of a run's tracks (n,) with the outlines that files have."""
    rows = run.tracks.impact_regions.tolist()
    texts = {id(row): json.loads(region_text(row)) for row in rows}
    regions = np.empty(len(rows), dtype=np.object_)
    for place, row in enumerate(rows):
        regions[place] = tuple(region_from_document(region) for region in texts[id(row)])
    return regions
