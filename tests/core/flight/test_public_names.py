"""`opir_core.flight` gives functions and classes by name, whatever was imported before."""

import subprocess
import sys
from inspect import isclass, isroutine

import pytest

import opir_core.flight

#: Each name in a process of its own, forked before anything of the package is imported.
EACH = """
import os, sys, types, numpy, scipy
for home, name in {names}:
    child = os.fork()
    if not child:
        __import__(home)
        found = getattr(__import__("opir_core.flight", fromlist=[name]), name)
        os._exit(0 if callable(found) and not isinstance(found, types.ModuleType) else 1)
    assert os.waitpid(child, 0)[1] == 0, name
"""


@pytest.mark.slow
def test_a_name_is_no_module_after_its_module_was_imported() -> None:
    values = {name: getattr(opir_core.flight, name) for name in opir_core.flight.__all__}
    names = [
        (value.__module__, name)
        for name, value in values.items()
        if isclass(value) or isroutine(value)
    ]
    assert len(names) > 10
    done = subprocess.run(
        [sys.executable, "-c", EACH.format(names=names)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="teleport"):
        _ = opir_core.flight.teleport


def test_listing_names_imports_nothing() -> None:
    code = "import opir_core.flight, sys\ndir(opir_core.flight)\nassert 'numpy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
