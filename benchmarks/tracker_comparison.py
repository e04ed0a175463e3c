"""The page that compares the trackers by what `opir compare` prints of one scene.

python benchmarks/tracker_comparison.py [--runs 5] [--write docs/explanation]
"""

import argparse
import contextlib
import io
import os
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from opir_core.cli.main import main as opir

SCENE = "examples/pacific_test_range.yaml"
SENSORS = "sensors=[{constellation: SBIRS-GEO}]"
TRACKERS = ("kepler-arc", "{model: kepler-arc, memory_s: 5}", "stereo-filter", "boost-profile")

PAGE = """# Three trackers on one scene

The paper's [kepler-arc](kepler-arc.md); the [stereo-filter](association.md), which knows how thrust, gravity and drag
act on any target; and [boost-profile](boost-profile.md), which knows the generic classes too. An ICBM, an IRBM and an
SRBM are seen by the default fleet of SBIRS-GEO. Made by
`python benchmarks/tracker_comparison.py --write docs/explanation`, which runs

```
opir compare {scene} --set "{sensors}" \\
{words} --runs {runs}
```

All four lines get the same detections and the same association, so they differ by their estimates alone. With a
`memory_s` kepler-arc forgets: it is no longer the paper's.

## What came out

```text
{told}
```

## How to read it

* **kepler-arc, the paper's.** One Keplerian arc is held against all detections of a boost. The longer the boost, the
  farther the arc is from where the target is: position and velocity errors grow with every bin, to many times the
  bound, while a least-squares fit believes that more detections tell more (NEES and NIS are far outside their bands,
  p is 0). The arc says what the speed has been on average, not what it is; so the range falls short, types are told
  too small, and no ellipse of the paper's σ₀ exp(−k n/N) holds the impact: that law shrinks with the count of
  detections, whatever the error is.
* **With a short memory** the arc follows the last seconds. It no longer drifts off, yet lags behind a target that
  accelerates, by about the acceleration times the memory, and its covariance knows nothing of that.
* **stereo-filter** has the specific force in its state, so it does not lag. It takes for granted that a boost is about
  along the velocity and grows slowly, whatever the class: so it may stand below the bound *with the thrust unknown*
  (/unknown below 1), which is what directions can tell with any force; with `boost_model: jerk` it stands at it. It
  tells an impact once the target coasts; until then where it comes down depends on when its burn ends, which is not
  in the directions.
* **boost-profile** is below that bound, for it knows what boosts of the generic classes look like; here its targets
  are such boosts. It too tells an impact once the burn is over, unless asked for it sooner. Truth of another family is
  the test of its covariances, and is not on this page.

What each figure is: [score tracks](../how-to/score-tracks.md).
"""


def compared(runs: int) -> str:
    """Return what `opir compare` prints."""
    words = ["compare", SCENE, "--set", SENSORS, "--runs", str(runs)]
    for tracker in TRACKERS:
        words += ["--tracker", tracker]
    with contextlib.redirect_stdout(io.StringIO()) as told:
        opir(words)
    return told.getvalue().rstrip()


def main() -> None:
    """Run the comparison and print, or write, the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--write", type=Path)
    chosen = parser.parse_args()
    words = " ".join(f'--tracker "{name}"' if " " in name else f"--tracker {name}" for name in TRACKERS)
    page = PAGE.format(scene=SCENE, sensors=SENSORS, words=f"    {words}", runs=chosen.runs, told=compared(chosen.runs))
    if chosen.write:
        (chosen.write / "comparing-trackers.md").write_text(page, encoding="utf-8")
    print(page)


if __name__ == "__main__":
    main()
