"""All benchmarks of the suite, from `suite.yaml`.

A new script needs one entry there. It writes its results as CSV files or Markdown tables into the
folder given by `--write`, or keeps them one by one (`figures.keep`); the suite reads both.
"""

import shlex
import shutil
from importlib.util import find_spec
from pathlib import Path

import yaml
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


def are_known(_self, _field, names):
    """Raise `KeyError` for a peer without a name."""
    for name in names:
        PEERS[name]


@frozen
class Benchmark:
    """A script, its arguments, and the folder of `docs` for its pages (`writes`: has `--write`).

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
    peers: tuple[str, ...] = field(default=(), validator=are_known)

    @classmethod
    def of(cls, entry):
        """Return the benchmark of an entry; words are separated as in a shell."""
        words = {
            key: tuple(shlex.split(str(entry.get(key, ""))))
            for key in ("quick", "full", "needs", "programs", "peers")
        }
        return cls(**{"script": f"{entry['name']}.py", **entry, **words})

    @property
    def path(self):
        """The script."""
        return FOLDER / self.script

    def arguments(self, *, quick, folder):
        """Return the command line behind `python`, whose results go into a folder."""
        words = self.quick if quick else self.full
        return [str(self.path), *words, *(["--write", str(folder)] if self.writes else [])]

    def missing(self):
        """Yield the required modules and programs that are not installed."""
        yield from (name for name in self.needs if find_spec(name) is None)
        yield from (name for name in self.programs if shutil.which(name) is None)

    def absent_peers(self):
        """Return the names of the peers that are not installed."""
        return [PEERS[name] for name in self.peers if find_spec(name) is None]


BENCHMARKS = tuple(
    Benchmark.of(entry)
    for entry in yaml.safe_load((FOLDER / "suite.yaml").read_text(encoding="utf-8"))
)
