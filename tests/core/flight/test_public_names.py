"""`opir_core.flight` gives functions and classes by name, whatever was imported before."""

import subprocess
import sys

import pytest

import opir_core.flight


@pytest.mark.parametrize("name", opir_core.flight.__all__)
def test_a_name_is_what_it_says_even_after_its_module_was_imported(name: str) -> None:
    home = getattr(opir_core.flight, name).__module__
    code = (
        f"import {home}, types\nfrom opir_core.flight import {name}\n"
        f"assert callable({name}) and not isinstance({name}, types.ModuleType)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="teleport"):
        _ = opir_core.flight.teleport


def test_listing_names_imports_nothing() -> None:
    code = "import opir_core.flight, sys\ndir(opir_core.flight)\nassert 'numpy' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
