"""The page for an operator: live launches first, earlier laps folded, filter, plots, sensors,
coverage.
"""

import pytest
from http_service import serving
from page_browser import PATIENCE_MS, chromium, opened
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

ROWS = (
    "() => [...document.querySelectorAll('#track-rows tr[data-track]')].map((row) =>"
    " Number(row.dataset.track))"
)


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def stand(tmp_path_factory):
    with serving(tmp_path_factory.mktemp("order"), "--speed", "5", "--tracker", "imm") as running:
        yield running


def track(number, ago_s, **fields):
    """Return an estimate of a track, with the seconds since it in place of its time."""
    types = {"ICBM": 0.9, "IRBM": 0.04, "SRBM": 0.04, "UNKNOWN": 0.02}
    place = {"latitude_deg": 10.0, "longitude_deg": -150.0 + number, "altitude_m": 1e3 * number}
    nothing = dict.fromkeys(("launch_point", "impact_point", "probability_launch", "end"))
    remainder = {
        "probability_burning": 0.5,
        "type_probability": types,
        "impact_regions": [],
        "hypotheses": None,
    }
    return {"track_id": number, "ago_s": ago_s, **place, **nothing, **remainder, **fields}


def shown(page, tracks):
    """Show these tracks and no other, at a time that is held."""
    page.wait_for_function("() => opirPlayer.timeS > 0")
    page.evaluate(
        "(tracks) => { document.getElementById('play').click(); opirStore.clear();"
        " opirStore.addTrack = Object.getPrototypeOf(opirStore).addTrack;"
        " for (const { ago_s: ago, ...each } of tracks)"
        " opirStore.addTrack({ ...each, timestamp: new Date((opirPlayer.timeS - ago) *"
        " 1000).toISOString() });"
        " opirStore.addTrack = () => {}; }",
        tracks,
    )


@pytest.mark.slow
def test_live_launches_are_first_and_ended_tracks_folded(browser, stand):
    page, complaints, _ = opened(browser, stand.port, 1280, "light")
    fire = {"hypotheses": {"ICBM": 0.01, "ground source": 0.99}, "probability_launch": 0.01}
    launch = {"hypotheses": {"ICBM": 0.8, "SLV": 0.2}, "probability_launch": 0.99}
    tracks = [
        track(1, 1.0, **fire), track(2, 1.0, **launch), track(3, 1.0, **launch), track(4, 900.0, **launch),
        track(5, 1.0, **launch, end="impact"),
    ]  # fmt: skip
    shown(page, tracks)
    page.wait_for_function(f"() => ({ROWS})().length === 4", timeout=PATIENCE_MS)
    assert page.evaluate(ROWS) == [3, 2, 1, 4]
    expect(page.locator("#earlier")).to_have_text("Earlier: 1")
    page.wait_for_function("() => opirMap.drawn.tracks === 4")
    page.locator("#earlier").click()
    page.wait_for_function(f"() => ({ROWS})().length === 5")
    assert page.evaluate(ROWS) == [3, 2, 1, 4, 5]
    page.locator("#filter").fill("ground")
    page.wait_for_function(f"() => ({ROWS})().join() === '1'")
    page.locator("#filter").fill("2")
    page.wait_for_function(f"() => ({ROWS})().join() === '2'")
    page.locator("#filter").fill("")
    page.locator("#sort").select_option("altitude")
    page.wait_for_function(f"() => ({ROWS})().join() === '4,3,2,1,5'")
    page.locator("#sort").select_option("number")
    page.wait_for_function(f"() => ({ROWS})().join() === '1,2,3,4,5'")
    assert not complaints
    page.context.close()


@pytest.mark.slow
def test_tracks_of_earlier_laps_are_folded(browser, stand):
    """By the clock of a looped scene: its laps begin at the epoch and one duration after
    another.
    """
    page, _, _ = opened(browser, stand.port, 1280, "dark")
    script = """async () => {
      const { Order } = await import("/page/order.js"), order = new Order();
      const clock = { epoch: "2026-04-01T12:00:00Z", duration_s: 300, speed: 5 }, at = Date.parse(clock.epoch) / 1000;
      const earlier = (last, now) => order.isEarlier({ timeS: at + last, end: null }, at + now);
      order.setClock({ ...clock, lap: 0 });
      const first = [earlier(10, 900)];
      order.setClock({ ...clock, lap: 3 });
      return [...first, earlier(900, 910), earlier(905, 910), earlier(590, 610), earlier(590, 599)];
    }"""
    assert page.evaluate(script) == [False, True, False, True, False]
    page.context.close()


@pytest.mark.slow
def test_a_selected_track_has_its_history_and_region(browser, stand):
    page, complaints, _ = opened(browser, stand.port, 1280, "light")
    ring = [[-151.0, 9.0], [-149.0, 9.0], [-149.0, 11.0], [-151.0, 11.0], [-151.0, 9.0]]
    figures = {
        "containment": 0.95,
        "condition": "burn over",
        "probability": 1.0,
        "effective_samples": 500.0,
    }
    geometry = {"type": "Polygon", "coordinates": [ring]}
    tracks = [
        track(
            7, ago, hypotheses={"ICBM": share, "SLV": 1.0 - share}, probability_launch=0.9,
            impact_point={"lat_deg": 10.0, "lon_deg": -150.0, "time": None, "method": "posterior", "ellipse": None},
            impact_regions=[figures | {"area_km2": area, "geometry": geometry}],
        )
        for ago, share, area in ((30.0, 0.5, 4e6), (20.0, 0.7, 4e5), (1.0, 0.9, 48_000.0))
    ]  # fmt: skip
    shown(page, tracks)
    page.locator("#track-rows tr[data-track='7'] button").click()
    label = "History: P(ICBM) 0.90; 95 % area, log 48,000 km²; Altitude 7 km"
    expect(page.locator("#history")).to_have_attribute("aria-label", label, timeout=PATIENCE_MS)
    inked = (
        "(id) => { const one = document.getElementById(id);"
        " const bytes = one.getContext('2d').getImageData(0, 0, one.width, one.height).data;"
        " return new Set(bytes.filter((_, at) => at % 4 === 0)).size; }"
    )
    assert page.evaluate(inked, "history") > 5
    assert page.evaluate(inked, "region") > 5
    curves = page.evaluate(
        "async () => (await import('/page/picked.js')).curvesOf(opirStore.tracks.get(7), Infinity)"
        ".map((each) => each.points.map(([, y]) => y))"
    )
    assert curves == [[0.5, 0.7, 0.9], [4e6, 4e5, 48_000.0], [7.0, 7.0, 7.0]]
    page.locator("#map").press("Escape")
    expect(page.locator("#plots")).to_be_hidden(timeout=PATIENCE_MS)
    assert not complaints
    page.context.close()


@pytest.mark.slow
def test_sensors_show_registration_and_innovations(browser, stand):
    page, complaints, _ = opened(browser, stand.port, 1280, "light")
    expect(page.locator("#sensor-rows tr[data-sensor]")).to_have_count(
        len(stand.service.status().sensors)
    )
    health = {
        "bias_rad": [60e-6, -12.4e-6], "bias_sigma_rad": [5e-6, 6e-6], "clock_s": 0.02, "clock_sigma_s": 0.01,
        "innovations": 1.04, "outlier_share": 0.02,
    }  # fmt: skip
    script = "async (sensor) => (await import('/page/sensors.js')).lineOf(sensor)"
    sensor = {"sensor_id": "S1", "state": "detecting", "health": health}
    odd = page.evaluate(script, sensor)
    assert odd == {
        "cells": ["S1", "detecting", "60 ± 5, -12 ± 6", "20 ± 10", "1.04", "0.02"],
        "isOdd": True,
    }
    fine = page.evaluate(script, sensor | {"health": health | {"bias_rad": [5e-6, 0.0]}})
    assert not fine["isOdd"]
    none = page.evaluate(script, sensor | {"health": None})
    assert none["cells"][2:] == ["–"] * 4
    page.locator("#sensor-rows button").first.click()
    assert str(page.evaluate("opirMap.selected")).startswith("sensor ")
    assert not complaints
    page.context.close()


@pytest.mark.slow
def test_coverage_marks_what_nobody_or_one_satellite_sees(browser, stand):
    """Of one geostationary satellite the cap of its horizon, acos(1/6.61) = 81.3°, has the share (1
    - 1/6.61)/2.
    """
    page, complaints, _ = opened(browser, stand.port, 1280, "light")
    alone = [{"position_ecef_m": [42_164_170.0, 0.0, 0.0], "field_of_regard_half_angle_deg": 10.0}]
    script = (
        "async (fleet) => (await import('/page/coverage.js')).coverage(fleet).map((each) =>"
        " each.count)"
    )
    counts = page.evaluate(script, alone)
    assert sum(counts) / len(counts) == pytest.approx(
        0.5 * (1.0 - 6_378_137.0 / 42_164_170.0), abs=0.01
    )
    narrow = [alone[0] | {"field_of_regard_half_angle_deg": 4.0}]
    assert 0 < sum(page.evaluate(script, narrow)) < 0.5 * sum(counts)
    assert set(page.evaluate(script, alone * 2)) == {0, 2}
    page.locator("#to-coverage").click()
    page.wait_for_function("() => opirMap.layers.gaps !== null")
    expect(page.locator(".k-cover")).to_be_visible()
    page.locator("#to-coverage").click()
    page.wait_for_function("() => opirMap.layers.gaps === null")
    assert not complaints
    page.context.close()
