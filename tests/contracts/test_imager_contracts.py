"""Civil imagers keep the contract of sensors."""

from collections.abc import Mapping
from typing import Any, ClassVar

from opir_testing import SensorContract


class TestAbi(SensorContract):
    name = "GOES-ABI"
    settings: ClassVar[Mapping[str, Any]] = {"orbital_slot_deg": -75.2, "preset": "mesoscale-30s"}


class TestAhi(SensorContract):
    name = "AHI"
    settings: ClassVar[Mapping[str, Any]] = {"orbital_slot_deg": 140.7, "preset": "landmark"}


class TestFci(SensorContract):
    name = "MTG-FCI"
    settings: ClassVar[Mapping[str, Any]] = {"orbital_slot_deg": 0.0, "preset": "rapid-scan"}
