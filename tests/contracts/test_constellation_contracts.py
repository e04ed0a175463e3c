"""The constellations beside the core keep their contracts, and so do presets and other ways to set
them.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

from opir_testing import ConstellationContract, SensorContract


class TestDsp(ConstellationContract):
    name = "DSP"


class TestHeritageDsp(SensorContract):
    name = "DSP"
    settings: ClassVar[Mapping[str, Any]] = {
        "preset": "heritage",
        "orbit": {"circular": {"altitude_km": 30_000.0, "inclination_deg": 63.4, "raan_deg": 0.0}},
    }


class TestSbirsGeo(ConstellationContract):
    name = "SBIRS-GEO"


class TestNextgenGeo(ConstellationContract):
    name = "NEXTGEN-GEO"


class TestHeoMolniya(ConstellationContract):
    name = "HEO-MOLNIYA"


class TestHeoTundra(ConstellationContract):
    name = "HEO-TUNDRA"


class TestLeoWide(ConstellationContract):
    name = "LEO-WIDE"


class TestLeoNarrow(ConstellationContract):
    name = "LEO-NARROW"


class TestLeoMedium(ConstellationContract):
    name = "LEO-MEDIUM"
