"""The coverage as an `xarray.Dataset`."""

import numpy as np
import xarray
from opir_coverage import coverage
from repository import ROOT


def test_a_dataset_has_coordinates_units_and_definitions(tmp_path):
    result = coverage(
        str(ROOT / "examples" / "arctic_watch.yaml"),
        target_class=None,
        grid_deg=30.0,
        steps=4,
        heights_km=(10.0,),
    )
    assert dict(result.sizes) == {
        "assets": 2,
        "height": 1,
        "time": 4,
        "latitude": 6,
        "longitude": 12,
    }
    assert result.revisit_time_max.attrs["units"] == "s"
    assert result.latitude.attrs["units"] == "degrees_north"
    assert int(result.in_view.sel(latitude=75.0, method="nearest").max()) > 0
    assert np.allclose(
        result.coverage_time.sel(assets=1), 100.0 * (result.in_view >= 1).mean("time")
    )
    assert isinstance(result, xarray.Dataset)
