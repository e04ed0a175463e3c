"""A contract class that lacks a method says which class must define what, and what that returns."""

import re
from typing import Any

import pytest
from opir_testing import ConformanceError, Contract
from opir_testing.contracts.radiometry import (
    EmitterContract,
    EnvironmentContract,
    RadiometricContract,
)


class Bare(Contract):
    """Lacks `scene`."""


class BareValues(RadiometricContract):
    """Lacks `values`."""


class BareEmitter(EmitterContract):
    """Lacks `signatures`, which its `values` need."""


class BareEnvironment(EnvironmentContract):
    """Lacks `model`."""


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (
            Bare.run,
            "Bare must define scene(**changes), which returns the test scene with the component",
        ),
        (Bare.part, "Bare must define part(), which returns what the component builds"),
        (
            BareValues().test_rows_are_computed_as_arrays,
            "BareValues must define values(band, rows), which returns",
        ),
        (
            BareEmitter().test_intensities_are_finite_and_not_negative,
            "BareEmitter must define signatures(), which returns the built signatures",
        ),
        (
            BareEnvironment.model,
            "BareEnvironment must define model(), which returns the built model",
        ),
    ],
    ids=["scene", "part", "values", "signatures", "model"],
)
def test_a_missing_method_is_named_with_its_class(act: Any, said: str) -> None:
    with pytest.raises(ConformanceError, match=f"^{re.escape(said)}") as raised:
        act()
    assert raised.value.change.endswith("inherit that of your kind from opir_testing.")
