"""An hour on brokers of Apache Kafka that are killed in turn, with restarts of the service; beside
it laps of a raid with the page open.

Two services. One delivers to a topic with three replicas, two of them in sync at least: each minute
a random broker is killed (SIGKILL) and started again 5 to 20 s later; every ten minutes the service
is killed or, by turns, stopped (SIGTERM), and started again with the same spool. A client reads its
stream: what it saw must be in the topic, in order. The other runs laps of a minute with many
launches under `imm` for the whole time, with its page in headless Chromium. Java, Maven and
Chromium are needed. `--machine` is a sentence on the machine, for the page.
"""

import random
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import ExitStack, closing, suppress
from functools import partial
from pathlib import Path

import numpy as np
import yaml
from page import opened_page
from pages import markdown_table, options_of, printed, publish
from scipy.stats import linregress, t
from soak import CALM_S, Criterion, criteria_table, draw, request, resident_mib, streamed
from soak_faults import PARTITIONS, TopicReader, apache_kafka

PAGE = """# An hour on three brokers, and an hour with a page

Is every event delivered while brokers and the service itself are killed, and is memory bounded in
laps with many targets? {answer}: {minutes:.0f} minutes, {kills} kills of a broker (SIGKILL),
{restarts} restarts of the service ({killed} after SIGKILL, the others after SIGTERM), {events}
events in the topic.

{rows}

![Memory of both services, heap of the page, and events waiting]({name}.svg)

**Brokers**: three nodes of Apache Kafka 4.1 (KRaft), {partitions} partitions, three replicas,
`min.insync.replicas` 2. `opir serve --loop --epoch-now` with `imm`, DSP and SBIRS-GEO, six launches
in laps of 5 minutes, and a [spool](../reference/outputs.md#the-spool). Lost is what a client of the
stream saw and the topic lacks; disordered, what came for the first time after a later event of its
sensor.

**Laps**: a second service, of one life: {laps} laps of a minute of `examples/raid_100.yaml` with
`imm` and {targets} targets at {speed:g} times real time, and its page in headless Chromium. All
share two cores with other work; the laps are up to {late_s:.0f} s late. The slope is that of least
squares of the laps' means of resident memory (VmRSS), with its 95 % interval. The heap of the page
is that of JavaScript with its garbage.

## Why a service was not ready

{unready} of {samples} samples, 5 s apart:

{reasons}

Samples: [{name}.csv]({name}.csv).
"""

NAME = "soak_brokers"
FOLDER = Path(__file__).parent
#: Time between samples, s.
SAMPLE_S = 5.0
#: How long a broker is away, s.
AWAY_S = (5.0, 20.0)
PANELS = {
    "memory of the service on brokers, MiB": "delivery_mib",
    "events waiting": "delivery_waiting",
    "memory of the laps, MiB": "raid_mib",
    "heap of the page, MB": "heap_mb",
}
IDS = re.compile(rb'"detection_id":"([0-9a-f-]{36})"')
#: Figures of a reason, and the place of a call that has not returned.
FIGURES = re.compile(r"[\d.]+ s: in .*|(?<![\[\d.])\d[\d.]*")


def raid_of(launches, **settings):
    """Return the scene of the raid with a number of its launches and other settings."""
    raid = FOLDER.parent / "examples" / "raid_100.yaml"
    scene = yaml.safe_load(raid.read_text(encoding="utf-8"))
    return scene | {"targets": scene["targets"][:launches], "tracker": "imm"} | settings


def delivery_scene(address, spool):
    """Return a scene of 5 minutes in which something always burns, with its output."""
    soak = yaml.safe_load((FOLDER / "soak.yaml").read_text(encoding="utf-8"))
    output = soak["outputs"][1]
    output["kafka"] |= {"bootstrap_servers": address, "topic": NAME, "spool": {"path": str(spool)}}
    scene = raid_of(6, scene=NAME, duration_s=300, sensors=soak["sensors"], outputs=[output])
    for number, target in enumerate(scene["targets"]):
        target["launch"]["time_s"] = 1.0 + 50.0 * number
    return scene


class Service:
    """`opir serve` with a scene, in one life after the other; `seen` are the ids that a client of
    the stream got.
    """

    def __init__(self, folder, scene, *words):
        self.seen = set()
        path = folder / f"{scene['scene']}.yaml"
        path.write_text(yaml.safe_dump(scene), encoding="utf-8")
        self._command = [sys.executable, "-m", "opir_core", "serve", str(path), "--loop"]
        self._command += ["--epoch-now", "--port", "0", "--changes", "", *words]
        self.lives = 0
        self.start()

    def start(self):
        """Begin a life."""
        self.lives += 1
        self._process = subprocess.Popen(self._command, stdout=subprocess.PIPE, text=True)
        self.port = int(self._process.stdout.readline().rpartition(":")[2])

    def watch(self):
        """Collect the ids of the stream of this life."""
        threading.Thread(target=self._watch, args=(self.port,), daemon=True).start()

    def _watch(self, port):
        for line in streamed(port, "/stream"):
            if line.startswith(b'data: {"cycle"'):
                self.seen.update(IDS.findall(line))

    def stop(self, number):
        """End the life with a signal."""
        self._process.send_signal(number)
        print(self._process.communicate(timeout=300.0)[0], flush=True)

    def close(self):
        """End it at once."""
        self._process.kill()

    def sample(self, name, reasons):
        """Return the columns of a name; count why it is not ready, "" if it does not say."""
        status = request(self.port, "GET", "/status")[1]
        is_ready = status["health"]["ready"]
        causes = [FIGURES.sub("…", reason) for reason in status["health"]["reasons"]]
        if not is_ready:
            reasons.update((name, cause) for cause in causes or [""])
        return {
            f"{name}_mib": resident_mib(self._process.pid),
            f"{name}_ready": int(is_ready),
            f"{name}_late_s": round(status["clock"]["late_s"], 1),
            f"{name}_lap": status["clock"]["lap"],
            f"{name}_waiting": status["sinks"][0]["spooled"],
        }


class Brokers:
    """Nodes of a cluster, of which a random one is away now and then."""

    def __init__(self, nodes, seed, every_s):
        self.kills = 0
        self.gone = None
        self._nodes = nodes
        self._rng = random.Random(seed)
        self._every_s = every_s
        self._back_s = 0.0

    def step(self, at_s):
        """Kill a node or start it again, if it is time."""
        if self.gone is not None and at_s >= self._back_s:
            self.end()
        if self.gone is None and at_s >= self._every_s * (self.kills + 1):
            self.gone = self._rng.choice(self._nodes)
            self.gone.stop(signal.SIGKILL)
            self.kills += 1
            self._back_s = at_s + self._rng.uniform(*AWAY_S)

    def end(self):
        """Start the node that is away."""
        if self.gone is not None:
            self.gone.start()
            self.gone = None


def heap_mb(session):
    """Return the size of the page's JavaScript heap, MB."""
    metrics = session.send("Performance.getMetrics")["metrics"]
    return next(row["value"] for row in metrics if row["name"] == "JSHeapUsedSize") / 1e6


def watched(options, delivery, raid, brokers, session, reasons):
    """Let brokers and service fail until the time is over; yield the samples, count the reasons."""
    duration_s = options.minutes * 60.0
    sample_due_s = 0.0
    start_s = time.monotonic()
    while (at_s := time.monotonic() - start_s) < duration_s:
        if at_s < duration_s - CALM_S:
            brokers.step(at_s)
            if at_s >= options.restart_every_s * delivery.lives:
                delivery.stop((signal.SIGTERM, signal.SIGKILL)[delivery.lives % 2])
                delivery.start()
                delivery.watch()
        if at_s >= sample_due_s:
            sample_due_s = max(sample_due_s + SAMPLE_S, at_s)
            row = delivery.sample("delivery", reasons) | raid.sample("raid", reasons)
            yield printed({"at_s": round(at_s, 1), **row, "heap_mb": heap_mb(session)})
        time.sleep(0.1)


def soaked(options, folder, facts, reasons):
    """Return the samples; fill the facts of the run and the reasons of samples not ready."""
    with ExitStack() as stack:
        cluster = stack.enter_context(apache_kafka(folder, NAME))
        scene = delivery_scene(cluster.address, folder / "spool")
        delivery = stack.enter_context(closing(Service(folder, scene)))
        delivery.watch()
        raid_scene = raid_of(options.targets, duration_s=60, outputs=["null"])
        raid = Service(folder, raid_scene, "--speed", str(options.speed))
        stack.callback(raid.close)
        view = stack.enter_context(opened_page(raid.port))
        session = view.context.new_cdp_session(view)
        session.send("Performance.enable")
        brokers = Brokers(cluster.nodes, options.seed, options.kill_every_s)
        samples = []
        with suppress(KeyboardInterrupt):
            samples.extend(watched(options, delivery, raid, brokers, session, reasons))
        brokers.end()
        cluster.wait_for_brokers(3)
        session.send("HeapProfiler.collectGarbage")
        facts |= {"heap_collected_mb": heap_mb(session), "kills": brokers.kills}
        delivery.stop(signal.SIGTERM)
        raid.stop(signal.SIGTERM)
        facts |= facts_of_topic(cluster.address, delivery.seen)
    facts |= {
        "targets": options.targets,
        "speed": options.speed,
        "restarts": delivery.lives - 1,
        "killed": delivery.lives // 2,
    }
    return samples


def facts_of_topic(address, seen):
    """Return what is in the topic, held against the ids that a client has seen."""
    with closing(TopicReader(address, NAME, sys.maxsize)) as reader:
        reader.wait_for_end()
    return {
        "seen": len(seen),
        "events": reader.messages,
        "lost": len({name.decode() for name in seen} - reader.recent.ids.keys()),
        "repeated": reader.recent.repeated,
        "disordered": reader.disordered,
    }


def slope_of(samples):
    """Return the slope of the memory of the laps in the last half, MiB an hour, and half its 95 %
    interval; nan for fewer than three whole laps.

    It is that of the means of whole laps, for samples of a lap are not independent.
    """
    laps = {}
    for row in samples[len(samples) // 2 :]:
        laps.setdefault(row["raid_lap"], []).append((row["at_s"] / 3600, row["raid_mib"]))
    means = np.array([np.mean(rows, axis=0) for rows in list(laps.values())[1:-1]])
    if len(means) < 3:
        return np.nan, np.nan
    fit = linregress(*means.T)
    return fit.slope, fit.stderr * t.ppf(0.975, len(means) - 2)


def criteria(samples, reasons):
    """Return the criteria."""
    facts = samples.facts
    slope, half = slope_of(samples)
    heap = max(samples.column("heap_mb"))
    silent = sum(row["samples"] for row in reasons if row["reason"] == "")
    lost = f"{facts['lost']} of {facts['seen']} that a client saw"
    size = f"{max(samples.column('raid_mib')):.0f} MiB at most"
    heaps = f"at most {heap:.0f} MB, {facts['heap_collected_mb']:.0f} MB after a collection"
    return [
        Criterion("no event lost", lost, facts["lost"] == 0),
        Criterion("none disordered", str(facts["disordered"]), facts["disordered"] == 0),
        Criterion("repeated (allowed)", str(facts["repeated"]), True),
        Criterion(
            "memory of the laps: below 2 MiB/h in the last half",
            f"{slope:.1f} ± {half:.1f} MiB/h; {size}",
            slope < 2.0,
        ),
        Criterion("heap of the page: at most 150 MB", heaps, heap <= 150.0),
        Criterion("not ready without a reason", f"{silent} samples", silent == 0),
    ]


def page(samples, reasons):
    """Return the page."""
    rows = criteria(samples, reasons)
    lines = [row.values() for row in reasons]
    unready = [2 - row["delivery_ready"] - row["raid_ready"] for row in samples]
    return PAGE.format(
        answer="Yes" if all(row.is_met for row in rows) else "No",
        rows=criteria_table(rows),
        name=NAME,
        partitions=PARTITIONS,
        minutes=samples[-1]["at_s"] / 60,
        laps=samples[-1]["raid_lap"],
        late_s=max(samples.column("raid_late_s")),
        samples=2 * len(samples),
        unready=sum(unready),
        reasons=markdown_table(("service", "reason", "samples"), lines),
        **samples.facts,
    )


def main():
    """Run the test; write its page where asked."""
    options = options_of(
        __doc__,
        minutes=60.0,
        seed=1,
        targets=100,
        speed=0.4,
        kill_every_s=60.0,
        restart_every_s=600.0,
    )
    facts = {}
    samples = []
    reasons = Counter()
    if options.from_csv is None:
        with tempfile.TemporaryDirectory() as folder:
            samples = soaked(options, Path(folder), facts, reasons)
    causes = [
        {"service": service, "reason": reason, "samples": count}
        for (service, reason), count in reasons.most_common()
    ]
    publish(
        options,
        page,
        partial(draw, panels=PANELS),
        facts,
        **{NAME: samples, f"{NAME}_reasons": causes},
    )


if __name__ == "__main__":
    main()
