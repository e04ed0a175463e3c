"""Launches that GOES-16 saw, by band and scan (CIMSS Satellite Blog), against what opir's plumes give its pixels.

The published facts and the thresholds, fixed before opir's answers were computed, are in
`tests/data/goes_sightings.json`. Two facts are missed at opir's middle level, and named here: burns against the flight
at 6.2 µm are 0.6 K, which is below the threshold of 1 K and above it within the stated spread. Such burns heat and stir
what they burn in, which opir's plumes do not know.
"""

import json

import pytest
from imager_pixels import pixel_k
from opir_photons.radiometry.propellants import propellants
from repository import DATA

TABLE = json.loads((DATA / "goes_sightings.json").read_text(encoding="utf-8"))
LOOKS, LEAST_K, SHARE = TABLE["looks"], TABLE["thresholds_k"], TABLE["share_in_brightest_pixel"]

#: Facts missed at the middle level: burns against the flight.
MISSED = {("entry burn", "B08"), ("boostback burn", "B08")}


def is_seen(look, band, factor=1.0):
    beside, brightest = pixel_k(look, band, SHARE, factor)
    return brightest - beside >= LEAST_K[band]


def is_missed(look, band):
    return any(words in look["what"] and band == own for words, own in MISSED)


FACTS = [(look, band, wanted) for look in LOOKS for wanted in ("seen", "unseen") for band in look[wanted]]


@pytest.mark.parametrize(("look", "band", "wanted"), FACTS, ids=[f"{look['what']}: {band}" for look, band, _ in FACTS])
def test_a_plume_is_seen_in_the_bands_in_which_it_was_seen(look, band, wanted):
    spread = propellants()[look["propellant"]].spread
    if wanted == "unseen":
        assert not is_seen(look, band, spread)
        return
    assert is_seen(look, band, spread), "beyond the stated spread"
    assert is_seen(look, band) != is_missed(look, band)


def test_nearly_all_facts_hold_at_the_middle_level():
    held = [is_seen(look, band) == (wanted == "seen") for look, band, wanted in FACTS]
    assert len(held) >= 20
    assert sum(held) >= 0.9 * len(held)


def test_each_launch_is_seen_at_its_first_scan():
    """The first look of each of the five is of the ascent; in all, 3.9 µm shows it at the middle level."""
    first = {look["post"]: look for look in reversed(LOOKS)}
    assert len(first) == 5
    assert all(is_seen(look, "B07") for look in first.values())
