"""Propagation under J2 against cases computed with mpmath (tests/data/reference_cases.json)."""

import json

import numpy as np
import pytest
from repository import DATA

from opir_core.flight.forces import Forces, ZonalField
from opir_core.flight.propagation import propagate

CASES = json.loads((DATA / "reference_cases.json").read_text(encoding="utf-8"))["cases"]
J2_CASES = [case for case in CASES if case["topic"] == "j2_propagation"]


@pytest.mark.parametrize("case", J2_CASES, ids=lambda case: case["id"])
@pytest.mark.parametrize("tolerance_m", [1e-1, 1e-2, 1e-4, 1e-6])
def test_j2(case, tolerance_m):
    inputs = case["inputs"]
    expected = case["expected"]
    gravity = ZonalField(
        mu_m3_s2=inputs["mu_km3_s2"] * 1e9, radius_m=inputs["Re_km"] * 1e3, j2=inputs["J2"]
    )
    start = np.array(inputs["r0_km"]) * 1e3, np.array(inputs["v0_km_s"]) * 1e3
    forces = Forces(zonal=("j2",), gravity=gravity)
    position, velocity = propagate(*start, inputs["dt_s"], forces, tolerance_m=tolerance_m)
    assert np.linalg.norm(position - np.array(expected["r_km"]) * 1e3) <= tolerance_m
    assert np.linalg.norm(velocity - np.array(expected["v_km_s"]) * 1e3) <= 1e-2 * tolerance_m


def test_there_are_cases():
    assert len(J2_CASES) == 2
