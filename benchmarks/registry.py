"""All benchmarks of the suite: what each asks, how it is run at full and at small size, and what it
needs.

A new script needs one entry here. It may write its results as CSV files or Markdown tables into the
folder given by `--write`, or keep them one by one (`figures.keep`); the suite reads both.
"""

import shutil
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from attrs import field, frozen

FOLDER = Path(__file__).resolve().parent

#: What each peer brings, by the module that is imported: the name that tables use.
PEERS = {
    "stonesoup": "Stone Soup",
    "filterpy": "FilterPy",
    "heyoka": "heyoka",
    "pykep": "pykep",
    "boinor": "boinor",
}
TRACKERS = ("stonesoup", "filterpy")


@frozen
class Benchmark:
    """A script, its arguments, and the folder of `docs` for its pages (`writes`: it has `--write
    FOLDER`).

    If it `judges`, exit code 1 says that a criterion is not met, which small sizes need not meet.
    Without `needs` (modules) and `programs` it cannot run; `peers` are modules that it leaves out
    if they are missing.
    """

    name: str
    question: str
    script: str
    quick: tuple[str, ...]
    writes: bool = True
    pages: str = "benchmarks"
    judges: bool = False
    full: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    programs: tuple[str, ...] = ()
    peers: tuple[str, ...] = field(
        default=(), validator=lambda _self, _field, names: [PEERS[name] for name in names]
    )

    @property
    def path(self) -> Path:
        """The script."""
        return FOLDER / self.script

    def arguments(self, *, quick: bool, folder: Path) -> list[str]:
        """Return the command line behind `python`, whose results go into a folder."""
        return [
            str(self.path),
            *(self.quick if quick else self.full),
            *(["--write", str(folder)] if self.writes else []),
        ]

    def missing(self) -> Iterator[str]:
        """Yield what the benchmark cannot run without and is not installed."""
        yield from (name for name in self.needs if find_spec(name) is None)
        yield from (name for name in self.programs if shutil.which(name) is None)

    def absent_peers(self) -> list[str]:
        """Return the peers that are not installed, by name."""
        return [PEERS[name] for name in self.peers if find_spec(name) is None]


def words(text: str) -> tuple[str, ...]:
    """Return the words of a command line."""
    return tuple(text.split())


BENCHMARKS = (
    Benchmark(
        "end_to_end",
        "What does each accuracy setting cost and buy, and are the defaults on the knee?",
        "end_to_end.py",
        ("--scenes", "one", "--duration", "12", "--knobs", "light time"),
        needs=("opir_trackers", "opir_studies"),
    ),
    Benchmark(
        "complexity",
        "How do time and memory grow with targets, sensors, duration and scan rate?",
        "complexity.py",
        words("--decades 0.3"),
    ),
    Benchmark(
        "throughput",
        "How many looks and events per second, from plan to JSON lines?",
        "throughput.py",
        words("--repeat 1 --targets 4"),
        writes=False,
    ),
    Benchmark(
        "raid",
        "How long does a raid of 1000 launches take, from plan to files of events and truth?",
        "raid.py",
        words("--launches 5 --duration 90"),
        writes=False,
    ),
    Benchmark(
        "startup", "How long does start-up take?", "startup.py", words("--repeat 1"), writes=False
    ),
    Benchmark(
        "skipping",
        "What does each optional part cost a scene that names it, and one that does not?",
        "skipping.py",
        words("--repeat 1 --only Sun"),
        needs=("opir_trackers",),
    ),
    Benchmark(
        "encoding",
        "Which encoding to JSON is fastest?",
        "encoding.py",
        words("--events 2000 --repeats 1"),
        writes=False,
    ),
    Benchmark(
        "studies",
        "What do worker processes and Dask cost a study?",
        "studies.py",
        words("--runs 8 --executors serial"),
        writes=False,
        needs=("opir_studies", "opir_dask"),
    ),
    Benchmark(
        "replicates",
        "How long do a million replicates of one launch take, and how exact are they?",
        "replicates.py",
        words("--runs 80 --workers 1"),
        needs=("opir_photons",),
    ),
    Benchmark(
        "live",
        "How old are events of a live run, and how many targets can it follow?",
        "live_pace.py",
        words("--seconds 4 --step 0 --speed 4"),
    ),
    Benchmark(
        "soak",
        "Does the service run long without leaks or losses, with faults around it?",
        "soak.py",
        words("--minutes 0.1"),
        judges=True,
        needs=("opir_http", "opir_kafka", "confluent_kafka"),
    ),
    Benchmark(
        "campaign",
        "What survives kills, failing disks and brokers, and damage?",
        "campaign.py",
        words("--minutes 0.05 --only spool"),
        writes=False,
        needs=("opir_http", "opir_kafka", "confluent_kafka"),
    ),
    Benchmark(
        "service",
        "How many requests and viewers can the service handle?",
        "service.py",
        words("--seconds 0.2 --clients 5"),
        needs=("opir_http",),
        programs=("wrk",),
    ),
    Benchmark(
        "page",
        "How many frames per second has the page with 1000 launches?",
        "page.py",
        words("--launches 5 --seconds 1"),
        needs=("opir_http", "playwright"),
        programs=("chromium",),
    ),
    Benchmark(
        "kafka",
        "How many events per second into Kafka?",
        "kafka.py",
        words("--events 2000 --repeats 1"),
        needs=("opir_kafka", "confluent_kafka"),
    ),
    Benchmark(
        "coverage",
        "What do the default constellations see of the Earth?",
        "earth_coverage.py",
        words("--step-s 43200"),
    ),
    Benchmark(
        "coverage_map",
        "How long does a map of coverage take?",
        "coverage_map.py",
        words("--grid 30"),
        writes=False,
    ),
    Benchmark(
        "first_detection",
        "When is each class first detected, by sensor, climate and cloud?",
        "first_detection.py",
        words("--targets 2 --climates 1"),
    ),
    Benchmark(
        "focal_plane",
        "Are P_d, P_fa, clutter and centroids of a focal plane those of simulated frames?",
        "focal_plane.py",
        words("--frames 10"),
    ),
    Benchmark(
        "discrimination",
        "How well are plumes separated from fires, flares and glints, and types from each other?",
        "discrimination.py",
        words("--launches 4 --sources 4"),
    ),
    Benchmark(
        "calibration",
        "Of what is reported with confidence p, how much is right?",
        "calibration.py",
        words("--launches 4 --sources 4 --seeds 1"),
    ),
    Benchmark(
        "left_out_classes",
        "Does `none of these` rise for a class left out, and is every probability right?",
        "left_out_classes.py",
        words("--launches 3 --sources 8"),
    ),
    Benchmark(
        "left_out_hypotheses",
        "Does `none of these` rise in imm for a class that it does not know?",
        "left_out_hypotheses.py",
        words("--launches 1 --only HGV"),
        needs=("opir_trackers", "opir_sbirs"),
    ),
    Benchmark(
        "kepler",
        "Two-body arcs: run time against error",
        "work_precision/kepler.py",
        words("--states 10 --checked 1 --repeat 1 --libraries opir heyoka pykep"),
        needs=("mpmath",),
        peers=("heyoka", "pykep", "boinor"),
    ),
    Benchmark(
        "propagation",
        "Numerical propagation: run time against error",
        "work_precision/propagation.py",
        words("--arcs 2 --repeat 1"),
        peers=("heyoka",),
    ),
    Benchmark(
        "ephemeris",
        "Trajectories as polynomials: run time against error",
        "work_precision/ephemeris.py",
        words("--targets 4 --points 10000 --repeat 1"),
    ),
    Benchmark(
        "atmosphere",
        "Transmittance: run time against error",
        "work_precision/atmosphere.py",
        words("--looks 1000 --repeat 1 --every 100"),
    ),
    Benchmark(
        "probability",
        "Interpolated P_d: run time against error",
        "work_precision/probability.py",
        (
            *words("--every 100 --looks 200 --repeat 1 --thin 100 --tolerances 1e-4 --chains"),
            "calibrated, empty space",
        ),
    ),
    Benchmark(
        "tracking",
        "Trackers: run time against error over the bound",
        "work_precision/tracking.py",
        words(
            "--runs 1 --peer-runs 1 --seconds 20 --raid-targets 5 --raid-seconds 2 --raid-seeds 1"
            " --scene-runs 0"
        ),
        needs=("opir_trackers", "opir_studies"),
        peers=TRACKERS,
    ),
    Benchmark(
        "tracking_scene",
        "The same for every tracker on one scene, at several cadences",
        "work_precision/tracking_scene.py",
        ("--runs", "1", "--only", "imm, 1 s", "FilterPy EKF, acceleration, true association, 1 s"),
        needs=("opir_trackers", "opir_studies"),
        peers=TRACKERS,
    ),
    Benchmark(
        "tracker_comparison",
        "How do kepler-arc and imm compare?",
        "tracker_comparison.py",
        words("--runs 1 --duration 130"),
        pages="explanation",
        needs=("opir_trackers", "opir_studies"),
    ),
    Benchmark(
        "raid_tracking",
        "A hundred launches in ten seconds with false alarms: are all tracked, and how fast?",
        "raid_tracking.py",
        words("--runs 1 --duration 25"),
        needs=("opir_trackers",),
    ),
    Benchmark(
        "tracker_honesty",
        "Do the regions of imm hold what they say, on flights that share nothing with it?",
        "tracker_honesty.py",
        ("--flights", "1", "--only", "2 stages"),
        needs=("opir_trackers",),
    ),
    Benchmark(
        "simulation_calibration",
        "Is what imm reports calibrated on flights of its own prior?",
        "simulation_calibration.py",
        ("--flights", "3"),
        needs=("opir_trackers",),
    ),
    Benchmark(
        "open_world",
        "Is what is hot a missile: fires, ascents to orbit and short of it, stages that fly back,"
        " gliders?",
        "open_world.py",
        words("--flights 1 --only short"),
        needs=("opir_trackers",),
    ),
    Benchmark(
        "tracking_set",
        "How do trackers compare on the published set of lines of sight of boosts?",
        "tracking_set/tracking_set.py",
        ("--cases", "one-launch", "--seeds", "2", "--trackers", "imm", "LMB filter"),
        needs=("opir_trackers", "opir_stonesoup", "stonesoup"),
    ),
    Benchmark(
        "registration",
        "Can the sensors be trusted: biases, clocks, noise and outliers, stated or not?",
        "registration.py",
        ("--runs", "1", "--only", "as stated"),
        needs=("opir_trackers",),
    ),
    Benchmark(
        "salvos",
        "Does `imm` separate the launches of a salvo?",
        "salvos.py",
        words("--runs 1 --halves 5"),
        needs=("opir_trackers",),
    ),
    Benchmark(
        "imm_consistency",
        "Is imm consistent in whole scenes, with clouds and biases?",
        "imm_consistency.py",
        words("--runs 1 --only clear"),
        needs=("opir_trackers",),
    ),
    Benchmark(
        "filter_stability",
        "Is the square-root filter numerically stable (against 50 digits)?",
        "filter_stability.py",
        words("--each 1 --slices 5"),
        needs=("opir_trackers", "mpmath"),
    ),
    Benchmark(
        "stability",
        "Which digits does each public function lose, against 40 digits?",
        "stability.py",
        words("--quick --only geometry.e"),
        needs=("mpmath", "matplotlib"),
    ),
)
