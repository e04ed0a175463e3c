"""The page as a tool: globe and map, picking, choosing places, the time axis, a saved run, and
axe's rules.
"""

import json
import math
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from http_service import SCENE, serving
from opir_http.replay import Replay
from page_browser import PATIENCE_MS, chromium, opened, settled, viewing
from playwright.sync_api import expect
from waiting import until

from opir_core.cli.main import main
from opir_core.output.saved_runs import load_run

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def stand(tmp_path_factory):
    with serving(
        tmp_path_factory.mktemp("tools"), "--speed", "20", "--tracker", "imm", "--loop"
    ) as running:
        yield running


@pytest.fixture(scope="module")
def saved_port(tmp_path_factory):
    folder = tmp_path_factory.mktemp("saved")
    (folder / "scene.yaml").write_text(SCENE, encoding="utf-8")
    words = [
        "--tracker",
        "imm",
        "--set",
        "duration_s=240",
        "--out",
        str(folder / "events.jsonl"),
        "--quiet",
    ]
    assert main(["run", str(folder / "scene.yaml"), *words]) == 0
    with viewing(Replay(load_run(Path(folder)))) as port:
        yield port


def tracked(page):
    """Return the number of the first track, which has a row by then."""
    expect(page.locator("#track-rows tr[data-track]").first).to_be_visible(timeout=PATIENCE_MS)
    return int(page.evaluate("[...opirStore.tracks.keys()][0]"))


@pytest.mark.slow
def test_marks_and_rows_select_each_other(browser, stand):
    page, complaints, _ = opened(browser, stand.port, 1280, "light")
    number = tracked(page)
    row = page.locator(f"#track-rows tr[data-track='{number}']")
    row.get_by_role("button").click()
    assert page.evaluate("opirMap.selected") == f"track {number}"
    expect(row.get_by_role("button")).to_have_attribute("aria-pressed", "true")
    page.locator("#map").press("Escape")
    expect(row.get_by_role("button")).to_have_attribute("aria-pressed", "false")
    page.get_by_role("button", name="Pause").click()
    settled(page)
    mark = page.evaluate(f"opirMap.layers.marks.find((each) => each.key === 'track {number}')")
    page.locator("#map").click(position={"x": mark["x"], "y": mark["y"]})
    selected = str(page.evaluate("opirMap.selected"))
    assert selected.startswith("track ")
    chosen = page.locator(f"#track-rows tr[data-track='{selected.removeprefix('track ')}']")
    expect(chosen.get_by_role("button")).to_have_attribute("aria-pressed", "true")
    expect(page.locator("#picked")).to_contain_text("P(burning)")
    assert (
        page.evaluate("opirMap.drawn.tracks")
        == page.locator("#track-rows tr[data-track]:not([hidden])").count()
    )
    assert not complaints
    page.context.close()


@pytest.mark.slow
def test_places_chosen_on_the_map_are_launched(browser, stand):
    page, complaints, _ = opened(browser, stand.port, 1280, "light")
    tracked(page)
    page.get_by_role("button", name="Choose both places").click()
    settled(page)
    for lon, lat in ((-155.0, 20.0), (170.0, 5.0)):
        x, y = page.evaluate(f"opirMap.xy({lon}, {lat})")
        page.locator("#map").click(position={"x": x, "y": y})
    inputs = [
        float(page.locator(f"[name={name}]").input_value())
        for name in ("launch_lon", "launch_lat", "aim_lon")
    ]
    assert inputs == pytest.approx([-155.0, 20.0, 170.0], abs=0.5)
    page.get_by_label("Type").select_option("IRBM")
    page.get_by_role("button", name="Launch", exact=True).click()
    expect(page.locator("#answer")).to_contain_text("launches at", timeout=PATIENCE_MS)
    assert not complaints
    page.context.close()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["map", "globe"])
def test_places_are_where_d3_has_them_and_keys_move_them(browser, stand, kind):
    page, complaints, _ = opened(browser, stand.port, 1280, "light")
    page.locator(f"#to-{kind}").click()
    canvas = page.locator("#map")
    for key in ("+", "+", "ArrowLeft", "ArrowDown", "-"):
        canvas.press(key)
    script = (
        "() => { const view = opirMap.view, far = []; for (let lon = -175; lon < 180; lon += 10)"
        " for (let lat = -85; lat < 90; lat += 10) { const found = opirMap.xy(lon, lat); if"
        " (!found) continue;"
        " const d3 = view.projection([lon, lat]); far.push(Math.hypot(found[0] - d3[0], found[1] -"
        " d3[1])); }"
        " return [far.length, Math.max(...far)]; }"
    )
    count, farthest = page.evaluate(script)
    assert count > 50
    assert farthest < 0.01
    view = page.evaluate("[opirMap.view.lon, opirMap.view.zoom]")
    canvas.press("ArrowRight")
    canvas.press("+")
    moved_view = page.evaluate("[opirMap.view.lon, opirMap.view.zoom]")
    assert (moved_view[0] - view[0]) % 360.0 == pytest.approx(
        60.0 / (math.pi / 180 * radius(page) / 1.4), rel=0.7
    )
    assert moved_view[1] == pytest.approx(1.4 * view[1])
    assert not complaints
    page.context.close()


def radius(page):
    return float(page.evaluate("opirMap.view.radius"))


@pytest.mark.slow
def test_only_what_lies_behind_the_earth_is_hidden_on_the_globe(browser, stand):
    page, _, _ = opened(browser, stand.port, 1280, "light")
    page.locator("#to-globe").click()
    page.evaluate("(opirMap.view.zoom = 0.13, opirMap.view.lookAt(0, 0))")
    visible = (
        "([lon, height]) => import('/page/view.js').then((view) =>"
        " opirMap.view.at(view.prepared(lon, 0, height)))"
    )
    height_m = 35_786_000.0
    # Seen from far in front, a body at this distance passes behind the Earth's disc within asin(R /
    # r) of its back.
    hidden_deg = math.degrees(math.asin(6_378_137.0 / (6_378_137.0 + height_m)))
    for away_deg, is_seen in ((hidden_deg + 0.5, True), (hidden_deg - 0.5, False), (90.0, True)):
        assert page.evaluate(visible, [180.0 - away_deg, height_m]) is is_seen
    assert page.evaluate(visible, [89.5, 0.0]) is True
    assert page.evaluate(visible, [90.5, 0.0]) is False
    page.context.close()


@pytest.mark.slow
def test_a_page_opened_late_has_the_past(browser, stand):
    early_page, _, _ = opened(browser, stand.port, 1280, "light")
    number = tracked(early_page)
    early_page.wait_for_function(
        f"() => opirStore.tracks.get({number}).trail.length > 5", timeout=PATIENCE_MS
    )
    early_page.context.close()
    page, complaints, _ = opened(browser, stand.port, 1280, "light")
    page.wait_for_function("() => opirStore.hits.length > 0 && opirStore.tracks.size > 0")
    spans = page.evaluate("[...opirStore.tracks.values()].map((track) => track.trail.length)")
    assert max(spans) > 5
    # Nothing is seen for most of a lap of this scene: its burn is 3 minutes of 10.
    until(lambda: max(map(sum, stand.ask("GET", "/activity").json["sensors"].values())) > 0)
    assert not complaints
    page.context.close()


@pytest.mark.slow
def test_a_saved_run_plays_and_is_searched(browser, saved_port):
    page, complaints, requests = opened(browser, saved_port, 1280, "dark", "saved")
    expect(page.locator("#launch-panel")).to_be_hidden()
    expect(page.locator("#track-rows tr[data-track]").first).to_be_visible(timeout=PATIENCE_MS)
    page.get_by_role("button", name="Pause").click()
    held = page.evaluate("opirPlayer.timeS")
    page.evaluate(SEEK, 180)
    page.wait_for_function(
        "() => opirStore.tracks.size > 0 && opirPlayer.loadedS > opirPlayer.timeS"
    )
    base = page.evaluate("opirPlayer.baseS()")
    assert page.evaluate("opirPlayer.timeS") - base == pytest.approx(180.0, abs=0.2)
    assert held != page.evaluate("opirPlayer.timeS")
    shown = page.evaluate(
        "opirStore.documentAt([...opirStore.tracks.values()][0], opirPlayer.timeS).timestamp"
    )
    assert "12:02:" in shown or "12:03:00" in shown
    page.evaluate(SEEK, 0.5)
    expect(page.locator("#track-rows")).to_contain_text("None yet")
    assert not complaints
    assert {url.split("/")[2] for url in requests} == {f"127.0.0.1:{saved_port}"}
    page.context.close()


#: Moves the time axis to a number of seconds.
SEEK = (
    "(second) => { const scrub = document.getElementById('scrub'); scrub.value = second;"
    " for (const name of ['input', 'change']) scrub.dispatchEvent(new Event(name)); }"
)


@pytest.mark.slow
@pytest.mark.parametrize("width", [400, 1024, 1600])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing(browser, stand, saved_port, width, scheme):
    for port, state in ((stand.port, "running"), (saved_port, "saved")):
        page, complaints, _ = opened(browser, port, width, scheme, state)
        tracked(page)
        page.locator("#track-rows button").first.click()
        assert violations(page) == []
        assert page.evaluate("document.documentElement.scrollWidth") == width
        page.goto(f"http://127.0.0.1:{port}/page/api.html")
        expect(page.get_by_label("GET /status", exact=True)).to_contain_text("Answers")
        assert violations(page) == []
        assert not complaints
        page.context.close()


def violations(page):
    result = Axe().run(page).response["violations"]
    return [
        (violation["id"], json.dumps([node["target"] for node in violation["nodes"]]))
        for violation in result
    ]


@pytest.mark.slow
def test_the_description_sends_requests(browser, stand):
    page, complaints, _ = opened(browser, stand.port, 1024, "light")
    page.goto(f"http://127.0.0.1:{stand.port}/page/api.html")
    page.get_by_role("button", name="Send GET /status").click()
    expect(page.get_by_label("Answer of /status")).to_contain_text('"scene": "stand"')
    assert not complaints
    page.context.close()
