"""Frames per second of the page for a raid of 1 000 launches, at rest and while the globe turns, in
headless Chromium.

The launches of ten seconds from a thousand notional sites in the open ocean are tracked from DSP.
Service, tracker and browser share the machine; the browser draws without a graphics processor. The
page counts a frame when it has drawn the map. A pan turns the globe by 2 pixels in each frame, so
everything is projected anew. Times are those between two frames; the processor time of the page's
main thread, per frame, is the same on a busy machine. Dropped windows and frames are those that the
service counts.
"""

import os
import random
import shutil
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import yaml
from pages import markdown_table, options_of
from playwright.sync_api import sync_playwright
from service import running, status

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
#: Longest time, s, until most launches have tracks.
PATIENCE_S = 240.0
#: Difference in latitude from the launch to the aim point by class, degrees.
RANGES_DEG = {"ICBM": 55.0, "IRBM": 22.0, "SRBM": 4.5}

PAGE = """# The page under a raid

How many frames per second does the page of `opir serve` draw with {launches} launches?

{table}

{tracks} tracks are on the map and in the table; service, tracker `{tracker}` and headless
Chromium {version} (no graphics processor) share {cores} cores with other work: the load average
is {load:.0f}. Times are those between two frames; the last column is the processor time of the
page's main thread for a frame. {windows} windows are dropped, and {frames} frames of the stream.
The run has {detections} detections by then.
"""
HEAD = ("view", "frames/s", "median, ms", "95 %, ms", "slowest, ms", "processor, ms")

COUNT = """async ({seconds, isTurning}) => {
  const times = [], before = opirMap.frames, began = performance.now();
  await new Promise((done) => {
    const step = (now) => {
      times.push(now);
      if (isTurning) { opirMap.view.pan(2, 0); opirMap.moved(); }
      if (performance.now() - began < seconds * 1000) requestAnimationFrame(step); else done();
    };
    requestAnimationFrame(step);
  });
  const passed = (performance.now() - began) / 1000;
  const gaps = times.slice(1).map((time, at) => time - times[at]).sort((one, other) => one - other);
  const share = (part) => gaps[Math.floor((gaps.length - 1) * part)];
  return [opirMap.frames - before, passed, share(0.5), share(0.95), share(1)];
}"""


def scene_of(launches, tracker):
    """Return a scene with a number of launches from 2 to 12 s, the same every time."""
    rng = random.Random(launches)
    targets = []
    for number in range(launches):
        kind = rng.choice(list(RANGES_DEG))
        lat_deg = rng.uniform(-35.0, 40.0)
        lon_deg = rng.uniform(-175.0, -125.0)
        launch = {
            "lat_deg": round(lat_deg, 3),
            "lon_deg": round(lon_deg, 3),
            "time_s": round(2.0 + 10.0 * number / launches, 3),
        }
        aim = {
            "lat_deg": round(lat_deg - RANGES_DEG[kind], 3),
            "lon_deg": round(lon_deg + 2.0, 3),
        }
        targets.append({"id": f"R{number:04}", "type": kind, "launch": launch, "aim": aim})
    return {
        "scene": f"raid-{launches}",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 600,
        "seed": 1,
        "sensors": [{"constellation": "DSP"}],
        "tracker": tracker,
        "targets": targets,
        "outputs": ["null"],
    }


def rate(page, view, seconds, *, is_turning):
    """Return a line of the table."""
    page.wait_for_timeout(1500)
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})
    before_s = busy_s(session)
    frames, passed_s, *gaps = page.evaluate(COUNT, {"seconds": seconds, "isTurning": is_turning})
    used_ms = 1000.0 * (busy_s(session) - before_s)
    session.detach()
    gap_cells = [f"{gap:.0f}" for gap in gaps]
    return [view, f"{frames / passed_s:.1f}", *gap_cells, f"{used_ms / max(frames, 1):.1f}"]


def busy_s(session):
    """Return the processor time of the page's main thread: scripts, layout, painting commands."""
    metrics = session.send("Performance.getMetrics")["metrics"]
    return float(next(row["value"] for row in metrics if row["name"] == "TaskDuration"))


def rates(page, seconds):
    """Return the lines of the table."""
    lines = [rate(page, "map, at rest", seconds, is_turning=False)]
    lines.append(rate(page, "map, panned", seconds, is_turning=True))
    page.evaluate("document.getElementById('to-globe').click()")
    lines.append(rate(page, "globe, at rest", seconds, is_turning=False))
    lines.append(rate(page, "globe, turning", seconds, is_turning=True))
    return lines


def wait_for_tracks(port, launches):
    """Wait until most launches have tracks, or for `PATIENCE_S` where the tracker is slower."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end and status(port)["counts"]["tracks"] < 0.95 * launches:
        time.sleep(1.0)


@contextmanager
def opened_page(port):
    """Yield the page of a service in headless Chromium."""
    executable = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=["--no-sandbox"])
        view = browser.new_page(viewport={"width": 1600, "height": 900})
        view.goto(f"http://127.0.0.1:{port}/")
        yield view
        browser.close()


def measured(port, launches, tracker, seconds, picture):
    """Return the page about a service; write a picture of it where asked."""
    with opened_page(port) as view:
        wait_for_tracks(port, launches)
        table = markdown_table(HEAD, rates(view, seconds))
        if picture:
            view.screenshot(path=str(picture))
        version = view.context.browser.version.partition(".")[0]
    state = status(port)
    return PAGE.format(
        launches=launches,
        tracks=state["counts"]["tracks"],
        tracker=tracker,
        version=version,
        cores=os.cpu_count(),
        load=os.getloadavg()[0],
        table=table,
        windows=state["viewers"]["dropped_windows"],
        frames=state["viewers"]["dropped_frames"],
        detections=state["counts"]["detections"],
    )


def main():
    """Measure and print; write the page where asked."""
    options = options_of(
        __doc__, launches=1000, seconds=15.0, tracker="kepler-arc", screenshot=Path
    )
    with tempfile.TemporaryDirectory() as folder:
        scene = Path(folder) / "raid.yaml"
        mapping = scene_of(options.launches, options.tracker)
        scene.write_text(yaml.safe_dump(mapping), encoding="utf-8")
        words = ["serve", str(scene), "--port", "0", "--max-targets", str(options.launches)]
        with running(sys.executable, "-m", "opir_core", *words) as port:
            text = measured(
                port, options.launches, options.tracker, options.seconds, options.screenshot
            )
    print(text)
    if options.write:
        (options.write / "page.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
