"""A crowd of tracks on the page: all are drawn where they are, have lines in the table, and can be
selected.
"""

import pytest
from http_service import serving
from page_browser import PATIENCE_MS, chromium, settled
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

COUNT = 200

#: Adds tracks on a grid, 2 degrees apart, each with an impact region that is a square of 3 degrees.
ADDED = """(count) => {
  const timestamp = new Date(opirStore.lastS * 1000).toISOString();
  for (let id = 1000; id < 1000 + count; id += 1) {
    const lat = -20 + 2 * Math.floor((id - 1000) / 20), lon = -40 + 2 * (id % 20), at = { lat_deg: lat, lon_deg: lon };
    const ring = [[lon, lat], [lon + 3, lat], [lon + 3, lat + 3], [lon, lat + 3], [lon, lat]];
    const region = { containment: 0.95, area_km2: 1e5, geometry: { type: "Polygon", coordinates: [ring] } };
    opirStore.addTrack({
      track_id: id, timestamp, latitude_deg: lat, longitude_deg: lon, altitude_m: 0, probability_burning: 0.5,
      type_probability: { ICBM: 1, IRBM: 0, SRBM: 0, UNKNOWN: 0 },
      launch_point: at, impact_point: at, state: {}, burnout: {}, impact_regions: [region],
    });
  }
}"""


@pytest.fixture(scope="module")
def stand(tmp_path_factory):
    with serving(tmp_path_factory.mktemp("crowd"), "--loop") as running:
        yield running


@pytest.fixture
def page(stand):
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(PATIENCE_MS)
        page.goto(f"http://127.0.0.1:{stand.port}/")
        expect(page.locator("#state")).to_have_text("running", timeout=PATIENCE_MS)
        page.wait_for_function("() => Number.isFinite(opirStore.lastS)")
        page.locator("#sort").select_option("number")
        page.evaluate(ADDED, COUNT)
        yield page


@pytest.mark.slow
def test_every_track_of_a_crowd_is_drawn_and_the_regions_of_some(page):
    page.wait_for_function(
        f"() => opirMap.drawn.tracks >= {COUNT} && opirMap.drawn.impacts >= {COUNT}",
        timeout=PATIENCE_MS,
    )
    left = page.locator("#left")
    expect(left).to_contain_text("areas of 12 of")
    assert page.evaluate("opirMap.drawn.regions") == 12
    page.evaluate("opirMap.selected = 'track 1100'")  # neither among the latest nor the largest
    expect(left).to_contain_text("areas of 13 of")


@pytest.mark.slow
def test_estimates_that_a_page_keeps_are_small(page):
    """Eight bytes a corner, and nothing that is never shown."""
    page.evaluate(f"for (let turn = 0; turn < 9; turn += 1) ({ADDED})({COUNT})")
    kept = page.evaluate(KEPT)
    assert kept["tracks"] == COUNT
    assert kept["bytes"] == kept["regions"] * 5 * 8
    assert kept["others"] == 0


#: Counts the added tracks, the regions of their estimates, the bytes of those, and other parts of
#: estimates that the page does not show.
KEPT = """() => {
  const kept = { tracks: 0, regions: 0, bytes: 0, others: 0 };
  for (const track of opirStore.tracks.values()) {
    if (track.id < 1000) continue;
    kept.tracks += 1;
    for (const { document } of track.past) {
      kept.others += "state" in document || "burnout" in document || "trail" in document;
      for (const region of document.impact_regions) {
        kept.regions += 1;
        for (const ring of region.geometry.coordinates) kept.bytes += ring.byteLength;
      }
    }
  }
  return kept;
}"""


@pytest.mark.slow
def test_every_track_of_a_crowd_has_a_line_in_the_table_of_which_those_in_view_are_made(
    page,
):
    page.wait_for_function(
        f"() => Number(document.getElementById('track-table').ariaRowCount) > {COUNT}"
    )
    page.locator("#play").click()  # no new tracks while lines are counted
    result = page.evaluate(LINES)
    assert len(result["ids"]) == page.evaluate("opirMap.drawn.tracks")
    assert result["ids"] == sorted(set(result["ids"]))
    assert set(range(1000, 1000 + COUNT)) <= set(result["ids"])
    assert result["ids"] == [int(text) for text in result["texts"]]
    assert result["places"] == list(range(2, 2 + len(result["ids"])))
    assert result["most"] < 60  # a screen of 900 pixels and what is around it
    assert max(result["heights"]) - min(result["heights"]) <= 1  # whole pixels of one height


@pytest.mark.slow
def test_the_keyboard_goes_through_lines_that_are_not_in_view_yet(page):
    page.wait_for_function(
        f"() => Number(document.getElementById('track-table').ariaRowCount) > {COUNT}"
    )
    page.locator("#play").click()
    page.locator("#track-rows button").first.focus()
    number = int(page.evaluate("document.activeElement.textContent"))
    for _ in range(50):
        page.keyboard.press("Tab")
        page.evaluate(
            "() => new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(go)))"
        )
    numbers = page.evaluate("[...opirStore.tracks.keys()].sort((one, other) => one - other)")
    assert (
        int(page.evaluate("document.activeElement.textContent"))
        == numbers[numbers.index(number) + 50]
    )


#: Scrolls through the table; returns numbers, texts and places of all lines in order, and how many
#: there were at once.
LINES = """async () => {
  const box = document.querySelector('.tracks .scroll'), lines = new Map(), heights = [];
  let most = 0;
  for (let top = 0; ; top += 40) {
    box.scrollTop = top;
    await new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(go)));
    const rows = [...document.querySelectorAll('#track-rows tr[data-track]')];
    most = Math.max(most, rows.length); heights.push(box.scrollHeight);
    for (const row of rows) lines.set(Number(row.ariaRowIndex), [Number(row.dataset.track), row.cells[0].textContent]);
    if (top + box.clientHeight >= box.scrollHeight) break;
  }
  const places = [...lines.keys()].sort((one, other) => one - other);
  const [ids, texts] = [0, 1].map((column) => places.map((at) => lines.get(at)[column]));
  return { places, ids, texts, most, heights };
}"""


@pytest.mark.slow
def test_a_track_of_a_crowd_is_selected_by_a_click_and_by_its_row(page):
    page.wait_for_function(f"() => opirMap.drawn.tracks >= {COUNT}", timeout=PATIENCE_MS)
    settled(page)
    # Track 1045 is at 16 degrees south, 30 degrees west.
    place = page.evaluate("opirMap.xy(-30, -16)")
    page.locator("#map").click(position={"x": place[0], "y": place[1]})
    page.wait_for_function("() => opirMap.selected === 'track 1045'")
    page.locator("#track-rows tr[data-track='1046'] button").press("Enter", timeout=PATIENCE_MS)
    page.wait_for_function("() => opirMap.selected === 'track 1046'")


#: The numbers that the map shows in its next frame; null if one lies over another.
NUMBERS = """() => new Promise((done) => {
  const { pen } = opirMap.layers, write = pen.fillText, boxes = [];
  pen.fillText = (text, x, y) => {
    const size = parseFloat(pen.font.match(/([\\d.]+)px/)[1]), width = pen.measureText(text).width;
    if (/^1\\d{3}$/.test(text)) boxes.push([Number(text), x, y - size, x + width, y]);
    write.call(pen, text, x, y);
  };
  const look = () => {
    if (!boxes.length) { requestAnimationFrame(look); return; }
    delete pen.fillText;
    const meet = ([, left, top, right, bottom], [, ...box]) => (
      box[0] < right && box[2] > left && box[1] < bottom && box[3] > top);
    const isHidden = boxes.some((one, at) => boxes.slice(0, at).some((other) => meet(one, other)));
    done(isHidden ? null : boxes.map(([id]) => id));
  };
  requestAnimationFrame(look);
})"""

#: Leaves some of the added tracks.
FEWER = "for (const id of [...opirStore.tracks.keys()]) if (id >= 1040) opirStore.tracks.delete(id)"


@pytest.mark.slow
def test_numbers_of_tracks_close_together_do_not_hide_each_other(page):
    page.locator("#play").click()
    page.evaluate(FEWER)
    page.wait_for_function("() => opirMap.drawn.tracks >= 40 && opirMap.drawn.tracks <= 60")
    assert len(page.evaluate(NUMBERS)) > 1
    page.evaluate("opirMap.selected = 'track 1005'")
    page.evaluate(NUMBERS)  # the frame that was under way
    assert 1005 in page.evaluate(NUMBERS)


@pytest.mark.slow
def test_ellipses_that_are_too_wide_to_be_drawn_are_not_said_to_be(page):
    expect(page.locator("#left")).to_contain_text("areas of 12 of", timeout=PATIENCE_MS)
    page.evaluate(
        "for (const { past } of opirStore.tracks.values()) for (const { document } of past) {"
        " document.impact_regions = [];"
        " if (document.impact_point) document.impact_point.ellipse ="
        " { semi_major_m: 3e6, semi_minor_m: 1e6, bearing_deg: 0 }; }"
    )
    expect(page.locator("#left")).to_be_hidden(timeout=PATIENCE_MS)
