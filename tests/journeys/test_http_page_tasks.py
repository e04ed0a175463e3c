"""The page for an operator who points sensors: at a track, refused, released, by keyboard, and what
is drawn of a narrow field.
"""

import numpy as np
import pytest
from http_service import serving
from operated_scene import OPERATED_SCENE
from page_browser import PATIENCE_MS, chromium, opened
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

FAR = "  - {model: generic-pointed, id: FAR, orbital_slot_deg: 70.0}\ntargets:"
SCENE = OPERATED_SCENE.replace("600", "900").replace("targets:", FAR)


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def stand(tmp_path_factory):
    with serving(tmp_path_factory.mktemp("tasks"), "--speed", "4", scene=SCENE) as running:
        yield running


def is_focused(page, selector):
    page.wait_for_function(f"() => document.activeElement.matches({selector!r})")


@pytest.mark.slow
def test_an_operator_points_a_sensor_by_keyboard_and_releases_it(browser, stand):
    page, complaints, _ = opened(browser, stand.port, 1280, "light")
    fields = page.locator("#field-rows")
    expect(fields).to_contain_text("nadir", timeout=PATIENCE_MS)
    expect(page.locator("#task")).to_be_hidden()
    page.locator("#track-rows button").first.wait_for(timeout=PATIENCE_MS)
    page.locator("#track-rows button").first.press("Enter")
    expect(page.locator("#task")).to_be_visible()
    page.locator("#map").press("p")
    is_focused(page, "#task select[name=sensor]")
    options = page.locator("#task select[name=sensor] option")
    expect(options.first).to_contain_text("SPOT")
    expect(options.last).to_have_text("FAR, behind the Earth")
    page.keyboard.press("Tab")
    is_focused(page, "#task select[name=mode]")
    page.keyboard.press("s")
    page.keyboard.press("Tab")
    is_focused(page, "#task button")
    # The director has the track at its next decision.
    page.wait_for_function(
        "() => { const text = document.getElementById('task-answer').textContent;"
        " if (!text.includes('looks at')) document.querySelector('#task button').click();"
        " return text.startsWith('SPOT looks at track 0 from 12:0'); }",
        polling=500,
        timeout=PATIENCE_MS,
    )
    spot = fields.locator("tr", has_text="SPOT")
    expect(spot).to_contain_text("operator", timeout=PATIENCE_MS)
    expect(spot).to_contain_text("stare")
    expect(spot.locator("td").nth(1)).to_have_text("track 0", timeout=PATIENCE_MS)
    aim = "() => opirStore.sensors.find((each) => each.sensor_id === 'SPOT').pointing"
    assert page.evaluate(aim)["track_id"] == 0
    spot.get_by_role("button", name="Release SPOT").press("Enter")
    expect(page.locator("#task-answer")).to_have_text("SPOT is released: the director commands it")
    expect(spot).to_contain_text("released", timeout=PATIENCE_MS)
    expect(spot.get_by_role("button", name="Release SPOT")).to_have_count(0)
    assert not complaints
    page.context.close()


@pytest.mark.slow
def test_a_refused_task_says_why_and_the_sensor_goes_on(browser, stand):
    page, complaints, _ = opened(browser, stand.port, 1280, "dark")
    page.locator("#track-rows button").first.click(timeout=PATIENCE_MS)
    page.locator("#task select[name=sensor]").select_option("FAR")
    expect(page.locator("#task select[name=mode]")).to_be_hidden()
    page.get_by_role("button", name="Point FAR at track 0").click()
    expect(page.locator("#task-answer")).to_have_text(
        "FAR goes on as it was: out of its field of regard, or behind the Earth"
    )
    expect(page.locator("#task-answer")).to_have_class("bad")
    expect(page.locator("#field-rows")).to_contain_text("refused: out of its", timeout=PATIENCE_MS)
    far = page.locator("#field-rows tr", has_text="FAR")
    expect(far).to_contain_text("nadir")
    far.get_by_role("button", name="FAR").click()
    expect(page.locator("#picked")).to_contain_text("Last command refused")
    # The browser reports the refused request.
    assert [text for text in complaints if "409" not in text] == []
    page.context.close()


#: The semi-axes of WGS 84, m; a satellite over the equator, whose section is a circle.
SEMI_MAJOR_M = 6378137.0
SEMI_MINOR_M = 6356752.314
SATELLITE_M = np.array([7.6e6, 0.0, 0.0])
HORIZON_DEG = np.degrees(np.arcsin(SEMI_MAJOR_M / SATELLITE_M[0]))


def drawn_ring(page, nadir_angle_deg):
    """Return directions (n, 3) from the satellite to the ring of a field of 3 degrees whose axis is
    so far from nadir, the vertical (n, 3) there, and their angles (n,) from the axis; None without
    a ring.
    """
    turn = np.radians(nadir_angle_deg)
    axis = np.array([-np.cos(turn), np.sin(turn), 0.0])
    script = "async ([at, point]) => (await import('/page/earth.js')).cone(at, point, 3)"
    shape = page.evaluate(script, [SATELLITE_M.tolist(), (SATELLITE_M + 1e6 * axis).tolist()])
    if shape is None:
        return None
    lon, lat = np.radians(shape["coordinates"][0]).T
    vertical = np.stack([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)
    squares_m2 = np.array([SEMI_MAJOR_M, SEMI_MAJOR_M, SEMI_MINOR_M]) ** 2
    scaled = vertical * squares_m2
    place_m = scaled / np.sqrt((vertical * scaled).sum(axis=1))[:, None]
    way = place_m - SATELLITE_M
    way /= np.linalg.norm(way, axis=1)[:, None]
    return way, vertical, np.degrees(np.arccos(way @ axis))


@pytest.mark.slow
def test_the_ground_in_a_field_is_drawn_up_to_the_horizon(browser, stand):
    page, _, _ = opened(browser, stand.port, 1280, "light")
    for nadir_angle_deg in (0.0, 30.0, HORIZON_DEG - 3.5):
        way, vertical, angle_deg = drawn_ring(page, nadir_angle_deg)
        assert angle_deg == pytest.approx(3.0, abs=1e-3)
        assert ((way * vertical).sum(axis=1) < 0.0).all(), "the far side is drawn"
    way, vertical, angle_deg = drawn_ring(page, HORIZON_DEG + 1.0)
    is_edge = np.abs(angle_deg - 3.0) < 1e-3
    grazing = np.abs((way * vertical).sum(axis=1)) < 1e-3
    assert (is_edge | grazing).all()
    assert is_edge.sum() > 5
    assert grazing.sum() > 5
    assert drawn_ring(page, HORIZON_DEG + 3.5) is None
    page.context.close()
