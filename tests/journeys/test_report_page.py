"""The report in a browser without a network: no request, no complaint, no overflow, in light, dark
and print.
"""

import pytest
from opir_report import write_run_report
from page_browser import chromium
from reported_runs import scored_run

pytestmark = pytest.mark.browser


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    return write_run_report(scored_run(), tmp_path_factory.mktemp("page") / "report.html")[0]


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [1280, 400])
def test_the_report_opens_without_a_network(browser, report, width, scheme):
    context = browser.new_context(
        viewport={"width": width, "height": 900}, color_scheme=scheme, offline=True
    )
    page = context.new_page()
    messages = []
    page.on("console", lambda message: messages.append(message.text))
    page.on("pageerror", lambda error: messages.append(str(error)))
    page.on(
        "request",
        lambda request: messages.append(request.url) if request.url != report.as_uri() else None,
    )
    page.goto(report.as_uri())
    assert not messages
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    ink, paper = page.evaluate(
        "[getComputedStyle(document.documentElement).color, _paper()]".replace("_paper()", _PAPER)
    )
    assert (brightness(ink) > brightness(paper)) == (scheme == "dark")
    # The pictures follow the page.
    assert page.evaluate("getComputedStyle(document.querySelector('svg text')).fill") == ink
    context.close()


_PAPER = "getComputedStyle(document.documentElement).backgroundColor"


def brightness(colour):
    """Return the sum of the parts of `rgb(1, 2, 3)`."""
    return sum(int(channel) for channel in colour.removeprefix("rgb(").removesuffix(")").split(","))


@pytest.mark.slow
def test_print_is_light_and_no_picture_is_cut(browser, report):
    page = browser.new_context(color_scheme="dark", offline=True).new_page()
    page.goto(report.as_uri())
    page.emulate_media(media="print")
    assert brightness(page.evaluate(_PAPER)) > 700
    assert (
        page.evaluate("getComputedStyle(document.querySelector('figure')).breakInside") == "avoid"
    )
    assert page.evaluate("getComputedStyle(document.querySelector('nav')).display") == "none"
