"""The page in a real browser: it loads, a launch goes out by its form, and what comes of it is
seen.
"""

import json
import re
from hashlib import sha256
from typing import Any

import pytest
from http_service import serving
from page_browser import PATIENCE_MS, chromium, opened
from playwright.sync_api import expect
from repository import ROOT

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def stand(tmp_path_factory):
    words = ("--speed", "5", "--tracker", "imm", "--loop")
    with serving(tmp_path_factory.mktemp("page"), *words) as running:
        yield running


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.mark.slow
def test_a_launch_by_the_form_is_detected_and_tracked(browser, stand):
    page, complaints, requests = opened(browser, stand.port, 1280, "light")
    page.get_by_label("Type").select_option("IRBM")
    page.get_by_label("Latitude").first.fill("22.0")
    page.get_by_label("Longitude").first.fill("-160.0")
    page.get_by_label("Longitude").first.press("Enter")
    expect(page.locator("#answer")).to_contain_text("launches at", timeout=PATIENCE_MS)
    expect(page.locator("#latest tr").first).to_contain_text("SBIRS-GEO", timeout=PATIENCE_MS)
    expect(page.locator("#track-rows")).to_contain_text("° N, 160", timeout=PATIENCE_MS)
    expect(page.locator("#sink-rows")).to_contain_text("open")
    assert page.evaluate("document.querySelectorAll('#timeline b').length") == 8
    page.get_by_label("Latitude").first.fill("95")
    page.get_by_role("button", name="Launch", exact=True).click()
    expect(page.locator("#answer")).to_have_class("bad")
    assert not complaints
    assert {url.split("/")[2] for url in requests} == {f"127.0.0.1:{stand.port}"}
    page.context.close()


@pytest.mark.slow
def test_launch_points_and_impact_ellipses_are_drawn_where_they_are(browser, stand):
    page, complaints, _ = opened(browser, stand.port, 1280, "dark")
    drawn = "() => opirMap.drawn.launches && opirMap.drawn.regions"
    page.wait_for_function(drawn, timeout=180_000)
    # A track of our own, and no other at the time that is held: marks are looked for by their
    # colours, and the regions of a boost that has just begun reach anywhere.
    page.evaluate("() => { document.getElementById('play').click(); opirStore.clear(); }")
    # What the page has asked for before may still arrive.
    page.wait_for_function(
        "() => { if (opirMap.drawn.tracks) opirStore.clear(); return !opirMap.drawn.tracks; }"
    )
    track = TRACK | {
        "timestamp": page.evaluate("new Date(opirPlayer.timeS * 1000 - 100).toISOString()")
    }
    page.evaluate(f"opirStore.addTrack({json.dumps(track)})")
    page.wait_for_function(f"() => ({SEEN})(-20, -30, 'launch') > 5")
    page.wait_for_function(f"() => ({SEEN})(40, -45, 'impact') > 5")
    on_the_ellipse = page.evaluate(f"({SEEN})(40, -36, 'impact')")  # 1000 km to the north
    page.evaluate(f"opirStore.addTrack({json.dumps(wide(track))})")
    page.wait_for_function(f"() => ({SEEN})(40, -36, 'impact') === 0")
    assert on_the_ellipse > 0
    assert page.evaluate(f"({SEEN})(40, -45, 'impact')") > 5
    assert not complaints
    page.context.close()


#: How many pixels near a place have about a colour of the page's.
SEEN = (
    "(lon, lat, name) => { const map = document.getElementById('map'), pen = map.getContext('2d'),"
    " of = opirMap;"
    " const hex = of.layers.colour[name], wanted = [1, 3, 5].map((at) => parseInt(hex.slice(at, at"
    " + 2), 16));"
    " const at = of.xy(lon, lat).map((place) => Math.round(place * of.layers.ratio) - 8);"
    " const found = pen.getImageData(at[0], at[1], 16, 16).data; let count = 0;"
    " for (let pixel = 0; pixel < found.length; pixel += 4)"
    " count += wanted.every((part, axis) => Math.abs(part - found[pixel + axis]) < 60);"
    " return count; }"
)
ELLIPSE = {"semi_major_m": 1.0e6, "semi_minor_m": 1.5e5, "bearing_deg": 0.0, "containment": 0.95}
TRACK: dict[str, Any] = {
    "track_id": 900,
    "latitude_deg": -35.0,
    "longitude_deg": 0.0,
    "altitude_m": 9.0e5,
    "impact_regions": [],
    "type_probability": {"ICBM": 0.7, "IRBM": 0.2, "SRBM": 0.1, "UNKNOWN": 0.0},
    "probability_burning": 0.25,
    "launch_point": {
        "lat_deg": -30.0,
        "lon_deg": -20.0,
        "ellipse": ELLIPSE | {"semi_major_m": 100.0},
    },
    "impact_point": {"lat_deg": -45.0, "lon_deg": 40.0, "ellipse": ELLIPSE},
}


def region(condition, probability, half_deg, samples):
    """Return a square region about the impact of `TRACK`."""
    west = 40.0 - half_deg
    east = 40.0 + half_deg
    south = -45.0 - half_deg
    north = -45.0 + half_deg
    ring = [[west, south], [east, south], [east, north], [west, north], [west, south]]
    figures = {
        "containment": 0.95,
        "area_km2": 1e4 * half_deg,
        "condition": condition,
        "probability": probability,
    }
    return figures | {
        "effective_samples": samples,
        "geometry": {"type": "Polygon", "coordinates": [ring]},
    }


@pytest.mark.slow
def test_a_track_shows_what_it_may_be_and_what_its_regions_presume(browser, stand):
    page, complaints, _ = opened(browser, stand.port, 1400, "light")
    page.wait_for_function("() => opirPlayer.timeS > 0")
    page.evaluate("() => { document.getElementById('play').click(); opirStore.clear(); }")
    weighed = TRACK | {
        "timestamp": page.evaluate("new Date(opirPlayer.timeS * 1000 - 100).toISOString()"),
        "hypotheses": {"noise": 0.0, "ground source": 0.002, "ICBM": 0.9, "SLV": 0.098},
        "probability_launch": 0.998, "probability_orbit": 0.098, "probability_comes_down": 0.9, "end": None,
        "impact_regions": [region("burn over", 0.8, 2.0, 500.0), region("relights", 0.1, 8.0, 40.0)],
    }  # fmt: skip
    plain = TRACK | {"track_id": 901, "timestamp": weighed["timestamp"], "latitude_deg": 60.0}
    page.evaluate(
        f"() => {{ opirStore.addTrack({json.dumps(weighed)});"
        f" opirStore.addTrack({json.dumps(plain)}); }}"
    )
    row, second_row = (
        page.locator(f"#track-rows tr[data-track='{number}'] td") for number in (900, 901)
    )
    expect(row.nth(1)).to_have_text("ICBM 0.90", timeout=PATIENCE_MS)
    expect(row.nth(7)).to_have_text("> 0.99")
    expect(second_row.nth(1)).to_have_text("ICBM")
    expect(second_row.nth(7)).to_have_text("–")
    assert page.locator("#track-table thead th").count() == row.count() == 8
    box = page.evaluate(
        "() => (({ scrollWidth, clientWidth }) => [scrollWidth, clientWidth])"
        "(document.querySelector('.tracks .scroll'))"
    )
    assert box[0] <= box[1], "columns are behind a scroll bar"
    page.locator("#track-rows tr[data-track='900'] button").click()
    details = page.locator("#picked")
    for words in (
        "SLV 0.10",
        "0.90",
        "if the burn is over: 20,000 km²; relights 0.10: 80,000 km², thin",
    ):
        expect(details).to_contain_text(words, timeout=PATIENCE_MS)
    page.wait_for_function("() => opirMap.drawn.regions >= 2")
    page.locator("#track-rows tr[data-track='901'] button").click()
    expect(details).not_to_contain_text("P(launch)", timeout=PATIENCE_MS)
    assert not complaints
    page.context.close()


def wide(track):
    """Return a track of which nobody knows yet where it comes down: its ellipse would cross the
    map.
    """
    return track | {
        "impact_point": track["impact_point"] | {"ellipse": ELLIPSE | {"semi_major_m": 4.0e6}}
    }


@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(375, "dark"), (1920, "dark"), (1920, "light")])
def test_the_page_fits_its_screen_and_its_map_is_drawn(browser, stand, width, scheme):
    page, complaints, _ = opened(browser, stand.port, width, scheme)
    page.wait_for_function("() => document.getElementById('map').width > 300")
    assert page.evaluate("document.documentElement.scrollWidth") == width
    script = (
        "() => { const map = document.getElementById('map'), pen = map.getContext('2d');"
        " const seen = new Set(pen.getImageData(0, 0, map.width, map.height).data.filter((_, at) =>"
        " at % 4 === 0));"
        " return seen.size; }"
    )
    page.wait_for_function(f"() => ({script})() > 20")
    unlabelled = (
        "[...document.querySelectorAll('#launch input, select')].filter((one) =>"
        " !one.labels.length).length"
    )
    assert page.evaluate(unlabelled) == 0
    assert contrast(page) >= 4.5
    assert not complaints
    page.context.close()


def contrast(page):
    """Return the least contrast of text against its panel (WCAG 2.2, relative luminance)."""
    colours = page.evaluate(
        "() => { const probe = document.createElement('i'); document.body.append(probe);"
        " const rgb = (name) => { probe.style.color = `var(--${name})`;"
        " return getComputedStyle(probe).color.match(/[0-9.]+/g).map(Number); };"
        " const reported = Object.fromEntries("
        "   ['panel', 'ground', 'ink', 'soft', 'bad', 'button', 'on-button'].map((name) => [name,"
        " rgb(name)]));"
        " probe.remove(); return reported; }"
    )
    pairs = [
        ("ink", "panel"),
        ("soft", "panel"),
        ("bad", "panel"),
        ("ink", "ground"),
        ("on-button", "button"),
    ]
    return min(ratio(colours[text], colours[ground]) for text, ground in pairs)


def ratio(colour, ground):
    light, dark = sorted((luminance(colour), luminance(ground)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def luminance(colour):
    channels = [channel / 255 for channel in colour[:3]]
    linear = [
        channel / 12.92 if channel <= 0.04045 else ((channel + 0.055) / 1.055) ** 2.4
        for channel in channels
    ]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_every_file_of_the_page_is_served_and_no_other(stand):
    folder = ROOT / "plugins" / "opir_http" / "opir_http" / "page"
    for path in [*folder.glob("*.*"), *folder.glob("vendor/*.js")]:
        answer = stand.ask(
            "GET", "/" if path.name == "index.html" else f"/page/{path.relative_to(folder)}"
        )
        assert (answer.status, answer.body) == (200, path.read_bytes())
    assert stand.ask("GET", "/page/vendor/README.md").status == 404
    assert stand.ask("GET", "/page/..%2fserving.py").status == 404


def test_files_from_elsewhere_are_those_of_the_table_beside_them():
    folder = ROOT / "plugins" / "opir_http" / "opir_http" / "page" / "vendor"
    table = re.findall(
        r"^\| `([^`]+)` .* `([0-9a-f]{64})` \|$",
        (folder / "README.md").read_text(),
        flags=re.MULTILINE,
    )
    assert dict(table) == {
        path.name: sha256(path.read_bytes()).hexdigest() for path in folder.glob("*.js")
    }
    assert {path.name for path in folder.glob("LICENSE-*")} == {
        "LICENSE-d3-array",
        "LICENSE-d3-geo",
    }
