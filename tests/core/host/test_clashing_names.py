"""`opir doctor` reports names that several plugins offer, with their owners."""

from typing import Any

import pytest

doctor = pytest.importorskip("opir_http.doctor", reason="needs opir-http")

COMMANDS = """
@hookimpl
def opir_add_commands(commands):
    commands.add_parser("chart", help="draw")
"""


def clashes() -> list[str]:
    return [plugin.text for plugin in doctor.plugins() if plugin.state == "warn"]


def test_a_component_of_two_plugins_is_reported_with_both(shop: Any, trackers: Any) -> None:
    shop.install("one", trackers("arc", "kalman"))
    shop.install("two", trackers("arc"), advertise=["trackers.arc"])
    (text,) = clashes()
    assert text.startswith(
        "two plugins offer the tracker 'arc': opir-one 1.0 (plugin one) and opir-two 1.0 (plugin"
        " two)"
    )
    assert "uninstall" in text


def test_a_command_of_two_plugins_is_reported_with_both(shop: Any) -> None:
    for name in ("one", "two"):
        shop.install(name, COMMANDS, advertise=["commands.chart"])
    (text,) = clashes()
    assert text.startswith(
        "two plugins offer the command 'chart': opir-one 1.0 (plugin one) and opir-two 1.0 (plugin"
        " two)"
    )


def test_plugins_with_names_of_their_own_do_not_clash(shop: Any, trackers: Any) -> None:
    shop.install("one", trackers("arc"))
    shop.install("two", trackers("kalman"))
    assert not clashes()
