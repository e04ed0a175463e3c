"""The page in a real browser: it loads, a launch goes out by its form, and what comes of it is seen."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from http_stand import Stand, serving
from playwright.sync_api import Browser, Page, expect, sync_playwright

BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
    words = ("--speed", "5", "--tracker", "stereo-filter")
    with serving(tmp_path_factory.mktemp("page"), *words) as running:
        yield running


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    assert found, "no Chromium: apt-get install chromium"
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
        yield running
        running.close()


def opened(browser: Browser, stand: Stand, width: int, scheme: Any) -> tuple[Page, list[str], list[str]]:
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
    page = context.new_page()
    complaints: list[str] = []
    asked: list[str] = []
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(f"http://127.0.0.1:{stand.port}/")
    expect(page.locator("#state")).to_have_text("running", timeout=20_000)
    return page, complaints, asked


def test_a_launch_by_the_form_is_detected_and_tracked(browser: Browser, stand: Stand) -> None:
    page, complaints, asked = opened(browser, stand, 1280, "light")
    page.get_by_label("Type").select_option("IRBM")
    page.get_by_label("Latitude").first.fill("22.0")
    page.get_by_label("Longitude").first.fill("-160.0")
    page.get_by_label("Longitude").first.press("Enter")
    expect(page.locator("#answer")).to_contain_text("goes up at", timeout=20_000)
    expect(page.locator("#latest tr").first).to_contain_text("SBIRS-GEO", timeout=20_000)
    expect(page.locator("#track-rows")).to_contain_text("° N, 160", timeout=40_000)
    expect(page.locator("#sink-rows")).to_contain_text("open")
    assert page.evaluate("document.querySelectorAll('#timeline b').length") == 8
    page.get_by_label("Latitude").first.fill("95")
    page.get_by_role("button", name="Launch").click()
    expect(page.locator("#answer")).to_have_class("bad")
    assert not complaints
    assert {url.split("/")[2] for url in asked} == {f"127.0.0.1:{stand.port}"}
    page.context.close()


@pytest.mark.parametrize(("width", "scheme"), [(375, "dark"), (1920, "dark"), (1920, "light")])
def test_the_page_fits_its_screen_and_its_map_is_drawn(browser: Browser, stand: Stand, width: int, scheme: str) -> None:
    page, complaints, _ = opened(browser, stand, width, scheme)
    page.wait_for_function("document.getElementById('map').width > 300")
    assert page.evaluate("document.documentElement.scrollWidth") == width
    script = (
        "() => { const map = document.getElementById('map'), pen = map.getContext('2d');"
        " const seen = new Set(pen.getImageData(0, 0, map.width, map.height).data.filter((_, at) => at % 4 === 0));"
        " return seen.size; }"
    )
    page.wait_for_function(f"({script})() > 20")
    unlabelled = "[...document.querySelectorAll('#launch input, select')].filter((one) => !one.labels.length).length"
    assert page.evaluate(unlabelled) == 0
    assert contrast(page) >= 4.5
    assert not complaints
    page.context.close()


def contrast(page: Page) -> float:
    """Return the least contrast of text against its panel (WCAG 2.2, relative luminance)."""
    colours = page.evaluate(
        "() => { const probe = document.createElement('i'); document.body.append(probe);"
        " const rgb = (name) => { probe.style.color = `var(--${name})`;"
        " return getComputedStyle(probe).color.match(/[0-9.]+/g).map(Number); };"
        " const told = Object.fromEntries("
        "   ['panel', 'ground', 'ink', 'soft', 'bad', 'button', 'on-button'].map((name) => [name, rgb(name)]));"
        " probe.remove(); return told; }"
    )
    pairs = [("ink", "panel"), ("soft", "panel"), ("bad", "panel"), ("ink", "ground"), ("on-button", "button")]
    return min(ratio(colours[one], colours[other]) for one, other in pairs)


def ratio(one: list[float], other: list[float]) -> float:
    light, dark = sorted((luminance(one), luminance(other)), reverse=True)
    return (light + 0.05) / (dark + 0.05)


def luminance(colour: list[float]) -> float:
    parts = [part / 255 for part in colour[:3]]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def test_every_file_of_the_page_is_served_and_no_other(stand: Stand) -> None:
    folder = Path(__file__).resolve().parents[2] / "plugins" / "opir_http" / "opir_http" / "page"
    for path in folder.iterdir():
        answer = stand.ask("GET", "/" if path.name == "index.html" else f"/page/{path.name}")
        assert (answer.status, answer.body) == (200, path.read_bytes())
    assert stand.ask("GET", "/page/..%2fserving.py").status == 404
