"""`opir new-plugin`: a package with a component of one's own, that installs and passes its contract at once."""

import argparse
import sys
from pathlib import Path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the kind, the name and the place."""
    from opir_core.cli.scaffold import KINDS

    parser.add_argument("kind", choices=list(KINDS), help="what it is to offer")
    parser.add_argument("name", metavar="NAME", help="what scenes call it, e.g. my-sensor; the package bears it too")
    parser.add_argument("--into", metavar="FOLDER", default=".", help="where its folder is made (default: here)")


def run(arguments: argparse.Namespace) -> int:
    """Write the package and say what to do next."""
    from opir_core.cli.scaffold import plugin_files, write_plugin
    from opir_core.plugin.host import Host

    contents = plugin_files(arguments.kind, arguments.name, Host.discover())
    folder = Path(arguments.into) / arguments.name
    write_plugin(folder, contents)
    name = arguments.name
    lines = [
        *(f"{folder / path}" for path in contents),
        "",
        "next:",
        f"  python -m pip install -e {_as_pip_path(folder)}",
        f"  opir check {name}",
        f"  opir run {folder / 'scene.yaml'}",
    ]
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def _as_pip_path(folder: Path) -> str:
    """Return a folder as pip takes it for one: a bare name would be looked for in an index."""
    return str(folder) if folder.is_absolute() else f"./{folder}"
