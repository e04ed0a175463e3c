"""The service's page in Chromium, with what its console says; the server of a saved run."""

import asyncio
import os
import shutil
import threading
from contextlib import contextmanager

import pytest
from opir_http.server import Server, bound
from opir_http.viewing import view_server
from playwright.sync_api import expect, sync_playwright

#: How long a page may take to show what it is waited for, on a machine that does other work, ms.
PATIENCE_MS = 60_000
BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@contextmanager
def chromium():
    """Start the system's Chromium; skips the test if there is none, unless it is required."""
    result = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if result is None and os.environ.get("OPIR_BROWSER") != "required":
        pytest.skip("no Chromium: apt-get install chromium")
    assert result, "no Chromium: apt-get install chromium"
    with sync_playwright() as playwright:
        running = playwright.chromium.launch(executable_path=result, args=["--no-sandbox"])
        yield running
        running.close()


def opened(browser, port, width, scheme, state="running"):
    """Open the page; return it with the messages of its console and the addresses that it
    requests.
    """
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme)
    context.set_default_timeout(PATIENCE_MS)
    page = context.new_page()
    complaints = []
    requests = []
    # Chromium's advice on reading a canvas often is for a test, which does, and not for the page,
    # which never does.
    page.on(
        "console",
        lambda message: complaints.extend(
            [message.text] if "willReadFrequently" not in message.text else []
        ),
    )
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("request", lambda request: requests.append(request.url))
    page.goto(f"http://127.0.0.1:{port}/")
    expect(page.locator("#state")).to_have_text(state, timeout=PATIENCE_MS)
    return page, complaints, requests


def settled(page):
    """Wait until the map has kept its place and size for a second: a click is at a position of the
    map as it was.
    """
    page.evaluate(
        "async () => { let same = 0, last = '';"
        " for (let turn = 0; turn < 100 && same < 5; turn++) {"
        " await new Promise((go) => setTimeout(go, 200));"
        " const box = document.getElementById('map').getBoundingClientRect();"
        " const now = [box.left, box.top, box.width, box.height, opirMap.view.radius].join();"
        " same = now === last ? same + 1 : 0; last = now; } }"
    )


@contextmanager
def viewing(replay):
    """Serve a saved run as `opir view` does; yields the port."""
    servers = list[Server]()
    begun = threading.Event()

    async def run():
        servers.append(view_server(replay, None, begun.set))
        await servers[0].serve(sockets=[listening])

    with bound("127.0.0.1", 0) as listening:
        thread = threading.Thread(target=lambda: asyncio.run(run()), daemon=True)
        thread.start()
        try:
            assert begun.wait(60.0), "the server does not start"
            yield listening.getsockname()[1]
        finally:
            for server in servers:
                server.should_exit = True
            thread.join(60.0)
