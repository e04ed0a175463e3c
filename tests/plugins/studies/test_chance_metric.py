"""The metric of drawn launches keeps the contract of metrics."""

from opir_testing import MetricContract


class TestChance(MetricContract):
    name = "chance"
    plugins = ("some_launches",)
