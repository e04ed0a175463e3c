"""Frames per second of the page for a raid of 1 000 launches, at rest and while the globe turns, in
headless Chromium.

    python benchmarks/page.py [--launches 1000] [--seconds 15] [--tracker kepler-arc] [--write
    docs/benchmarks]

The launches of ten seconds from a thousand notional sites in the open ocean are tracked from DSP.
Service, tracker and browser share the machine; the browser draws without a graphics processor. The
page counts a frame when it has drawn the map. A pan turns the globe by 2 pixels in each frame, so
everything is projected anew. Times are those between two frames; the processor time of the page's
main thread, per frame, is the same on a busy machine. Dropped windows and frames are those that the
service counts.
"""

import argparse
import http.client
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import yaml
from playwright.sync_api import CDPSession, Page, sync_playwright

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
FIRST_S = 2.0
LAST_S = 12.0
DURATION_S = 600
#: Longest time, s, until most launches have tracks.
PATIENCE_S = 240.0
#: Latitudes and longitudes of the launches, and the difference to their aim points, degrees.
LATITUDES = (-35.0, 40.0)
LONGITUDES = (-175.0, -125.0)
RANGES = {"ICBM": 55.0, "IRBM": 22.0, "SRBM": 4.5}

PAGE = """# The page under a raid

How many frames per second does the page of `opir serve` draw with {launches} launches?

{table}

{tracks} tracks are on the map and in the table; service, tracker `{tracker}` and headless Chromium {version} (no
graphics processor) share {cores} cores with other work: the load average is {load:.0f}. Times are those between two
frames; the last column is the processor time of the page's main thread for a frame. {windows} windows are dropped, and
{frames} frames of the stream. The run has {detections} detections by then.
"""

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


class Rate(NamedTuple):
    """Frames per second; median, 95 % and longest times between two frames; the page's processor
    time a frame; ms.
    """

    view: str
    per_s: float
    median_ms: float
    late_ms: float
    longest_ms: float
    processor_ms: float


def scene_of(launches: int, tracker: str) -> dict[str, Any]:
    """Return a scene with a number of launches."""
    rng = random.Random(launches)  # the same scene every time
    targets = []
    for number in range(launches):
        kind = rng.choice(list(RANGES))
        lat = rng.uniform(*LATITUDES)
        lon = rng.uniform(*LONGITUDES)
        time_s = FIRST_S + (LAST_S - FIRST_S) * number / launches
        launch = {"lat_deg": round(lat, 3), "lon_deg": round(lon, 3), "time_s": round(time_s, 3)}
        aim = {"lat_deg": round(lat - RANGES[kind], 3), "lon_deg": round(lon + 2.0, 3)}
        targets.append({"id": f"R{number:04}", "type": kind, "launch": launch, "aim": aim})
    return {
        "scene": f"raid-{launches}",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": DURATION_S,
        "seed": 1,
        "sensors": [{"constellation": "DSP"}],
        "tracker": tracker,
        "targets": targets,
        "outputs": ["null"],
    }


@contextmanager
def served(scene: Path, launches: int) -> Iterator[int]:
    """Serve a scene with the `opir` of this interpreter; yield its port."""
    code = "import sys; from opir_core.cli.main import main; sys.exit(main(sys.argv[1:]))"
    words = ["serve", str(scene), "--port", "0", "--max-targets", str(launches)]
    process = subprocess.Popen(
        [sys.executable, "-c", code, *words], stdout=subprocess.PIPE, text=True
    )
    try:
        assert process.stdout is not None
        yield int(process.stdout.readline().rpartition(":")[2])
    finally:
        process.terminate()
        process.communicate(timeout=30.0)


def status(port: int) -> Any:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60.0)
    connection.request("GET", "/status")
    answer = json.loads(connection.getresponse().read())
    connection.close()
    return answer


def rate(page: Page, view: str, seconds: float, *, is_turning: bool) -> Rate:
    page.wait_for_timeout(1500)
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})
    before_s = busy_s(session)
    frames, passed_s, *gaps = page.evaluate(COUNT, {"seconds": seconds, "isTurning": is_turning})
    used_ms = 1000.0 * (busy_s(session) - before_s)
    session.detach()
    return Rate(view, frames / passed_s, *gaps, used_ms / max(frames, 1))


def busy_s(session: CDPSession) -> float:
    """Return the processor time of the page's main thread, s: scripts, layout and painting
    commands.
    """
    metrics = session.send("Performance.getMetrics")["metrics"]
    return float(next(each["value"] for each in metrics if each["name"] == "TaskDuration"))


def measured(page: Page, seconds: float) -> list[Rate]:
    rates = [rate(page, "map, at rest", seconds, is_turning=False)]
    rates.append(rate(page, "map, panned", seconds, is_turning=True))
    page.evaluate("document.getElementById('to-globe').click()")
    rates.append(rate(page, "globe, at rest", seconds, is_turning=False))
    rates.append(rate(page, "globe, turning", seconds, is_turning=True))
    return rates


def table(rates: list[Rate]) -> str:
    rows = [
        "| view | frames/s | median, ms | 95 %, ms | slowest, ms | processor, ms |",
        "|---|---|---|---|---|---|",
    ]
    for one in rates:
        gaps = " | ".join(f"{gap:.0f}" for gap in (one.median_ms, one.late_ms, one.longest_ms))
        rows.append(f"| {one.view} | {one.per_s:.1f} | {gaps} | {one.processor_ms:.1f} |")
    return "\n".join(rows)


def until_tracked(port: int, launches: int) -> None:
    """Wait until most launches have tracks, or for `PATIENCE_S` where the tracker is slower."""
    end = time.monotonic() + PATIENCE_S
    while time.monotonic() < end:
        now = status(port)
        if now["counts"]["tracks"] >= 0.95 * launches:
            return
        time.sleep(1.0)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--launches", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=15.0, help="time for each count")
    parser.add_argument("--tracker", default="kepler-arc")
    parser.add_argument("--screenshot", type=Path, help="write a picture of the page here")
    parser.add_argument("--write", type=Path, help="write the page here")
    arguments = parser.parse_args()
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        scene = Path(folder) / "raid.yaml"
        scene.write_text(
            yaml.safe_dump(scene_of(arguments.launches, arguments.tracker)), encoding="utf-8"
        )
        with served(scene, arguments.launches) as port:
            browser = playwright.chromium.launch(executable_path=found, args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": 1600, "height": 900})
            page.goto(f"http://127.0.0.1:{port}/")
            until_tracked(port, arguments.launches)
            rates = measured(page, arguments.seconds)
            now = status(port)
            if arguments.screenshot:
                page.screenshot(path=str(arguments.screenshot))
            text = PAGE.format(
                launches=arguments.launches,
                tracks=now["counts"]["tracks"],
                tracker=arguments.tracker,
                version=browser.version.partition(".")[0],
                cores=os.cpu_count(),
                load=os.getloadavg()[0],
                table=table(rates),
                windows=now["viewers"]["dropped_windows"],
                frames=now["viewers"]["dropped_frames"],
                detections=now["counts"]["detections"],
            )
            browser.close()
    sys.stdout.write(text)
    if arguments.write:
        (arguments.write / "page.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
