"""Alerts of the page: off until chosen, once a track, for health, remembered in the browser."""

import pytest
from http_service import LAUNCH, serving
from page_browser import PATIENCE_MS, chromium, opened
from playwright.sync_api import expect

pytestmark = pytest.mark.browser

#: Notes each tone and notification in place of making it.
LISTEN = """() => {
  window.tones = []; window.notes = [];
  OscillatorNode.prototype.start = function () { tones.push(this.frequency.value); };
  OscillatorNode.prototype.stop = () => {};
  window.Notification = class {
    static permission = "granted";
    static requestPermission() { return Promise.resolve("granted"); }
    constructor(_, { body }) { notes.push(body); }
  };
}"""


@pytest.fixture(scope="module")
def browser():
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def stand(tmp_path_factory):
    words = ("--speed", "5", "--tracker", "imm", "--loop", "--when-late", "slow")
    with serving(tmp_path_factory.mktemp("alerts"), *words) as running:
        yield running


@pytest.fixture
def page(browser, stand):
    """Return a page that listens; nothing comes from elsewhere, and nothing complains."""
    page, complaints, requests = opened(browser, stand.port, 1280, "light")
    page.evaluate(LISTEN)
    yield page
    assert not complaints
    assert {url.split("/")[2] for url in requests} == {f"127.0.0.1:{stand.port}"}
    page.context.close()


def report(number, probability, end=None):
    """Return an estimate of a track that the service does not have."""
    return {
        "track_id": 90_000 + number,
        "timestamp": "2026-04-01T12:01:02.000000Z",
        "probability_launch": probability,
        "hypotheses": {"ICBM": 0.9, "ground source": 0.1},
        "type_probability": {},
        "end": end,
    }


def arrive(page, *reports):
    page.evaluate("(reports) => opirAlerts.tracks(reports)", list(reports))


def notes(page, words):
    """Return the notifications with these words: the service itself may have others."""
    return [note for note in page.evaluate("notes") if words in note]


def choose(page, *names):
    for name in names:
        page.locator(f"#alert-{name}").check()
    page.evaluate("() => { tones.length = notes.length = 0; }")


@pytest.mark.slow
def test_alerts_are_off_until_they_are_chosen(page):
    arrive(page, report(1, 1.0))
    page.evaluate(
        "opirAlerts.health({ ready: false, reasons: ['a test'] }, '2026-04-01T12:00:00Z')"
    )
    assert page.evaluate("[tones.length, notes.length, localStorage.length]") == [0, 0, 0]
    expect(page.locator("#alert-last")).to_have_text("")


@pytest.mark.slow
def test_each_track_alerts_once_above_the_threshold(page):
    choose(page, "launch", "sound", "notify")
    arrive(page, report(1, 0.89), report(2, 0.95, end="impact"))
    assert notes(page, "Track 9000") == []
    arrive(page, report(1, 0.9))
    assert notes(page, "Track 9000") == ["Track 90001: launch, ICBM"]
    assert page.evaluate("tones.length") >= 3
    arrive(page, report(1, 0.99), report(3, None))
    assert notes(page, "Track 9000")[1:] == ["Track 90003: launch, ICBM"]
    arrive(page, *(report(number, 1.0) for number in range(1, 9)))
    assert notes(page, "probable launches") == ["6 probable launches"]
    page.locator("#alert-pick").click()
    assert str(page.evaluate("opirMap.selected")).startswith("track ")


@pytest.mark.slow
def test_a_launch_in_the_stream_alerts(page, stand):
    page.locator("#alert-probability").fill("0.01")
    choose(page, "notify")
    page.locator("#alert-launch").check()  # last: a track of the laps alerts at once, and only once
    assert stand.ask("POST", "/trigger", LAUNCH).status == 202
    page.wait_for_function("() => notes.length > 0", timeout=PATIENCE_MS)
    expect(page.locator("#alert-last")).to_contain_text("launch")
    number = page.evaluate("Number(opirAlerts.told.values().next().value)")
    page.wait_for_function(
        f"() => opirStore.tracks.get({number}).past.length > 3", timeout=PATIENCE_MS
    )
    assert len(notes(page, f"Track {number}:")) == 1


@pytest.mark.slow
def test_health_alerts_when_it_is_lost_and_not_again(page):
    choose(page, "health", "notify")
    told = (
        "for (const reason of ['one reason', 'another'])"
        " opirAlerts.health({ ready: false, reasons: [reason] }, '2026-04-01T12:00:00Z');"
    )
    page.evaluate(f"() => {{ opirAlerts.isReady = true; {told} }}")
    assert notes(page, "reason") == ["Not ready: one reason"]
    assert notes(page, "another") == []
    page.evaluate("opirAlerts.isReady = true; opirAlerts.health(null)")
    assert notes(page, "not answer") == ["Not ready: the service does not answer"]


@pytest.mark.slow
def test_the_choice_is_remembered_and_a_wrong_threshold_is_not_taken(page):
    choose(page, "launch", "health")
    page.locator("#alert-probability").fill("0.75")
    page.locator("#alert-probability").fill("7")
    page.locator("#alert-probability").press("Tab")
    page.reload()
    expect(page.locator("#alert-launch")).to_be_checked()
    expect(page.locator("#alert-health")).to_be_checked()
    expect(page.locator("#alert-sound")).not_to_be_checked()
    expect(page.locator("#alert-probability")).to_have_value("0.9")
    page.locator("#alert-probability").fill("0.6")
    page.locator("#alert-probability").press("Tab")
    page.reload()
    expect(page.locator("#alert-probability")).to_have_value("0.6")


@pytest.mark.slow
def test_a_refusal_of_notifications_is_said(page):
    page.evaluate("() => { Notification.requestPermission = async () => 'denied'; }")
    page.locator("#alert-notify").check()
    expect(page.locator("#alert-hint")).to_contain_text("refuses notifications")
