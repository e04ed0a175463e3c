"""The forecasters `arc` and `none` as parts of `imm`, held to the contract of trackers; one that
returns another shape is named.
"""

import numpy as np
import pytest
from opir_forecast import Forecaster, LaunchForecasts
from opir_testing import TrackerPartContract
from repository import EXAMPLES

import opir_core as opir
from opir_core.errors import ModelError
from opir_core.plugin import Host, TrackerPart, hookimpl


class TestArc(TrackerPartContract):
    name = "arc"


class TestNone(TrackerPartContract):
    name = "none"


class Narrow(Forecaster):
    def forecasts(self, estimates, time_s):
        count = len(estimates)
        nothing = np.full(count, np.nan)
        return LaunchForecasts.without_impacts(np.ones((count, 2)), nothing, *[nothing] * 3)


class Parts:
    @hookimpl
    def opir_tracker_parts(self):
        yield TrackerPart(
            name="narrow",
            summary="two hypotheses",
            role="forecast",
            build=lambda _config, _context: Narrow(),
            reads=(),
        )


def test_a_forecast_of_another_shape_is_refused_with_its_owner():
    host = Host.discover()
    host.register(Parts())
    scene = opir.load_scene(
        EXAMPLES / "first_light.yaml",
        overrides=["tracker={model: imm, forecast: narrow}", "duration_s=60", "outputs=[]"],
        host=host,
    )
    with pytest.raises(ModelError, match=r"part 'narrow' of plugin .* must return forecasts of"):
        opir.run_of_plan(opir.compile_plan(scene, host))
