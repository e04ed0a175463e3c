"""The core's target classes pass the conformance tests of their hook."""

from opir_testing import TargetClassContract

from opir_core.scene import core_target_classes


class TestIcbm(TargetClassContract):
    name = "ICBM"


class TestIrbm(TargetClassContract):
    name = "IRBM"


class TestSrbm(TargetClassContract):
    name = "SRBM"


class TestMrbm(TargetClassContract):
    name = "MRBM"


class TestSlbm(TargetClassContract):
    name = "SLBM"


class TestHgv(TargetClassContract):
    name = "HGV"


class TestSlv(TargetClassContract):
    name = "SLV"


def test_every_class_of_the_core_is_tested_here():
    tested = {
        kind.name for kind in TargetClassContract.__subclasses__() if kind.__module__ == __name__
    }
    assert tested == set(core_target_classes())
