"""The page of a coverage in a browser without a network: maps of every layer, no complaint, no
overflow, and print.
"""

import pytest
from opir_coverage import CoverageSettings, computed_coverage
from opir_coverage.page import page_of
from opir_coverage.summary import table_rows
from page_browser import chromium
from repository import ROOT

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    settings = CoverageSettings(target_class=None, grid_deg=30.0, steps=5, heights_km=(10.0, 500.0))
    result = computed_coverage(ROOT / "examples" / "arctic_watch.yaml", settings)
    path = tmp_path_factory.mktemp("coverage") / "coverage.html"
    path.write_text(page_of(result, table_rows(result)), encoding="utf-8")
    return path


#: The colour of the pixel in the middle of the map.
_MIDDLE = """(() => {
  const c = document.getElementById("canvas"), x = c.width / 2 + 5, y = c.height / 2 + 5;
  return [...c.getContext("2d").getImageData(x, y, 1, 1).data];
})()"""


@pytest.mark.slow
@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (400, "dark")])
def test_every_layer_is_drawn_without_a_network(browser, written, width, scheme):
    context = browser.new_context(
        viewport={"width": width, "height": 900}, color_scheme=scheme, offline=True
    )
    page = context.new_page()
    messages = []
    page.on("console", lambda message: messages.append(message.text))
    page.on("pageerror", lambda error: messages.append(str(error)))
    page.goto(written.as_uri())
    page.wait_for_selector("body[data-ready=in_view]")
    names = page.evaluate(
        "JSON.parse(document.getElementById('data').textContent).layers.map((one) => one.name)"
    )
    assert "revisit_time_max" in names
    for number, name in enumerate(names):
        page.select_option("#layer", str(number))
        page.wait_for_selector(f"body[data-ready={name}]")
        assert page.is_visible("#time") == (name == "in_view")
    page.select_option("#layer", "0")
    page.wait_for_selector("body[data-ready=in_view]")
    page.select_option("#choose-height", "1")
    assert page.evaluate(_MIDDLE)[3] == 255
    page.hover("#canvas", position={"x": width // 3, "y": 60})
    assert "°" in page.text_content("#reading")
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    assert not messages
    context.close()


@pytest.mark.slow
def test_print_has_the_map_and_no_controls_that_cannot_be_used(browser, written):
    page = browser.new_context(color_scheme="dark", offline=True).new_page()
    page.goto(written.as_uri())
    page.wait_for_selector("body[data-ready=in_view]")
    page.emulate_media(media="print")
    assert page.is_visible("#canvas")
    assert not page.is_visible("#play")
    assert not page.is_visible("#time")
