"""Commands that plugins add: lazily by name, all for help, and each with its owner."""

import argparse
import sys

import pytest

from opir_core.cli.main import main
from opir_core.cli.plugin_commands import added_commands
from opir_core.errors import PluginError
from opir_core.plugin import Host

AGAIN = "\n  install again from a clone of opir: python -m pip install ./plugins/opir_{}"

COMMAND = """
@hookimpl
def opir_add_commands(commands):
    for name in {names}:
        parser = commands.add_parser(name, help="from {owner}")
        parser.set_defaults(run=lambda arguments: "{owner}")
"""


def command(owner, *names):
    return COMMAND.format(owner=owner, names=list(names))


@pytest.fixture
def parser():
    return argparse.ArgumentParser(prog="opir")


@pytest.fixture
def commands(parser):
    subparsers = parser.add_subparsers()
    subparsers.add_parser("run").set_defaults(run=lambda arguments: "core")
    return subparsers


def test_a_command_is_added_and_runs(shop, parser, commands):
    shop.install("http", command("http", "serve"), advertise=["commands.serve"])
    assert added_commands(Host.discover(), commands, "serve") == ("serve",)
    arguments = parser.parse_args(["serve"])
    assert arguments.run(arguments) == "http"
    assert parser.parse_args(["run"]).run(None) == "core"
    assert commands.choices["serve"].description == "From http."


def test_only_the_owner_of_a_command_is_imported(shop, commands, trackers):
    shop.install("http", command("http", "serve"), advertise=["commands.serve"])
    shop.install("other", command("other", "watch"), advertise=["commands.watch"])
    shop.install("arc", trackers("arc"), advertise=["trackers.arc"])
    shop.install("silent", command("silent", "hum"))
    assert added_commands(Host.discover(), commands, "serve") == ("hum", "serve")
    assert {"opir_http", "opir_other", "opir_arc", "opir_silent"} & set(sys.modules) == {
        "opir_http",
        "opir_silent",
    }


def test_help_has_all_commands(shop, parser, commands, trackers):
    shop.install(
        "http", command("http", "serve", "watch"), advertise=["commands.serve", "commands.watch"]
    )
    shop.install("arc", trackers("arc"), advertise=["trackers.arc"])
    shop.install("silent", command("silent", "hum"))
    assert added_commands(Host.discover(), commands) == ("hum", "serve", "watch")
    assert "opir_arc" not in sys.modules
    assert "from silent" in parser.format_help()


def test_a_command_that_nobody_has(shop, commands):
    assert added_commands(Host.discover(), commands, "serve") == ()
    assert set(commands.choices) == {"run"}


def test_commands_in_the_catalogue(shop):
    shop.install(
        "http", command("http", "serve", "watch"), advertise=["commands.watch", "commands.serve"]
    )
    assert [row.commands for row in Host.discover().catalogue()] == [(), ("serve", "watch")]


@pytest.mark.parametrize("first", [(), ("commands.serve",)])
@pytest.mark.parametrize("second", [(), ("commands.serve",)])
def test_two_owners_of_one_command(shop, caplog, parser, commands, first, second):
    shop.install("http", command("http", "serve"), advertise=first)
    shop.install("acme", command("acme", "serve"), version="2", advertise=second)
    complaint = (
        "two plugins offer the command 'serve': opir-acme 2 (plugin acme) and opir-http 1.0 (plugin"
        " http)\n"
        "  uninstall all of them but one, or set OPIR_PLUGINS to the plugins to use, without acme"
        " or http"
    )
    with pytest.raises(PluginError) as error:
        added_commands(Host.discover(), commands, "serve")
    assert str(error.value) == complaint
    if first and second:
        assert not {"opir_http", "opir_acme"} & set(sys.modules)
    caplog.clear()
    help_commands = argparse.ArgumentParser().add_subparsers()
    assert added_commands(Host.discover(), help_commands) == ("serve",)
    assert caplog.messages == [complaint]


def test_a_contest_about_another_command_is_let_be(shop, commands):
    shop.install("one", command("one", "serve", "hum"))
    shop.install("two", command("two", "serve"))
    assert added_commands(Host.discover(), commands, "hum") == ("hum", "serve")


@pytest.mark.parametrize(
    ("code", "advertise", "reason"),
    [
        (
            "1 / 0",
            "serve",
            "cannot be imported: ZeroDivisionError: division by zero (opir_http/plugin.py, line 3)",
        ),
        (
            (
                "@hookimpl\ndef opir_add_commands(commands):\n    commands.add_parser('serve')\n    1 /"
                " 0"
            ),
            "serve",
            (
                "opir_add_commands raised ZeroDivisionError: division by zero (opir_http/plugin.py,"
                " line 6)"
            ),
        ),
        (
            command("http", "serve", "run"),
            "serve",
            "opir_add_commands adds the command 'run', which is a command of opir itself",
        ),
        (
            command("http", "serve", "serve"),
            "serve",
            "opir_add_commands adds the command 'serve' twice",
        ),
    ],
)
def test_a_command_whose_plugin_fails(shop, caplog, commands, code, advertise, reason):
    shop.install("http", code, version="5", advertise=[f"commands.{advertise}"])
    with pytest.raises(PluginError) as error:
        added_commands(Host.discover(), commands, "serve")
    assert str(error.value) == (
        f"the command 'serve' cannot be used, because its plugin failed\n  failed: opir-http 5"
        f" (plugin http): {reason}"
    )
    caplog.clear()
    help_commands = argparse.ArgumentParser().add_subparsers()
    help_commands.add_parser("run")
    added_commands(Host.discover(), help_commands)
    assert caplog.messages == [f"plugin left out: opir-http 5 (plugin http): {reason}"]


@pytest.mark.parametrize(
    ("added", "advertised", "stale"),
    [
        (("listen",), ("serve",), {"serve": False}),
        ((), ("serve",), {"serve": False}),
        (("watch", "serve"), ("serve",), {"watch": True}),
        (("serve",), ("serve", "watch"), {"watch": False}),
    ],
)
def test_a_stale_command_costs_itself(shop, caplog, parser, commands, added, advertised, stale):
    code = command("http", *added) + "\n@hookimpl\ndef opir_trackers():\n    return ()\n"
    shop.install("http", code, advertise=[f"commands.{name}" for name in advertised])
    for name, is_unlisted in stale.items():
        difference = (
            "offers it, but its installed entry points do not list it"
            if is_unlisted
            else "lists it in its installed entry points, but does not offer it"
        )
        message = (
            f"the command {name!r} cannot be used: opir-http 1.0 (plugin http) {difference}"
            f"{AGAIN.format('http')}"
        )
        if not is_unlisted:
            with pytest.raises(PluginError) as error:
                added_commands(Host.discover(), argparse.ArgumentParser().add_subparsers(), name)
            assert str(error.value) == message
        assert added_commands(Host.discover(), commands) == tuple({"serve"} & set(added))
        assert message in caplog.messages
        assert name not in commands.choices


def test_commands_are_grouped_in_the_help(shop, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "100")
    code = command("http", "serve").replace('"http")', '"http", group="look")')
    shop.install("http", code, advertise=["commands.serve"])
    shop.install("misc", command("misc", "hum"), advertise=["commands.hum"])
    with pytest.raises(SystemExit):
        main(["--help"])
    groups = {
        lines[0].strip(): [line.split()[0] for line in lines[1:]]
        for block in capsys.readouterr().out.partition("commands:\n\n")[2].split("\n\n")
        if (lines := block.splitlines())[0].startswith("  ")
    }
    assert "serve" in groups["look at scenes and runs:"]
    assert groups["other commands:"] == ["hum"]
    assert groups["run a scene:"][0] == "run"


def test_components_are_used_though_no_command_is_listed(shop, trackers, caplog):
    shop.install("one", trackers("arc") + command("one", "serve"), advertise=["trackers.arc"])
    assert Host.discover().component("opir_trackers", "arc").name == "arc"
    assert caplog.messages == [
        (
            "opir-one 1.0 (plugin one): its installed entry points differ from what it offers:"
            " commands.*; install again: python -m pip install --force-reinstall opir-one"
        )
    ]


def test_what_a_plugin_sees_of_argparse(shop, parser, commands):
    code = """
    @hookimpl
    def opir_add_commands(commands):
        assert "run" in commands.choices
        commands.add_parser("serve", aliases=["s"]).add_argument("--port", type=int)
    """
    shop.install("http", code, advertise=["commands.serve"])
    assert added_commands(Host.discover(), commands, "serve") == ("s", "serve")
    assert parser.parse_args(["s", "--port", "8"]).port == 8
