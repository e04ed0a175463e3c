"""Somebody else's environment: opir-core from its wheel, packages of their own, and nothing of this
checkout.
"""

import os
import subprocess
import sys
import venv
from pathlib import Path

import pytest
from attrs import frozen
from repository import ROOT


@frozen
class Outsider:
    """An environment with opir-core installed from its wheel; third-party packages are those of
    this environment.
    """

    folder: Path
    environment: Path

    def python(self, *words, cwd=None):
        """Run that environment's Python."""
        return self.run(str(self.environment / "bin" / "python"), *words, cwd=cwd)

    def opir(self, *words, cwd=None):
        """Run that environment's `opir`."""
        return self.run(str(self.environment / "bin" / "opir"), *words, cwd=cwd)

    def install(self, *packages, cwd=None):
        """Install wheels and folders, without asking an index."""
        python = str(self.environment / "bin" / "python")
        offline = (
            "--quiet",
            "--no-deps",
            "--no-index",
            "--no-build-isolation",
            "--disable-pip-version-check",
        )
        done = self.run(
            sys.executable, "-m", "pip", "--python", python, "install", *offline, *packages, cwd=cwd
        )
        assert done.returncode == 0, done.stderr

    def run(self, *words, cwd=None):
        """Run a command with that environment first on the path."""
        inputs = self.variables()
        return subprocess.run(
            words, cwd=cwd or self.folder, env=inputs, capture_output=True, text=True, check=False
        )

    def variables(self):
        """Return the environment's variables: that environment first on the path, and nothing of
        ours.
        """
        result = ("PYTHONPATH", "OPIR_PLUGINS", "PYTEST_ADDOPTS")
        clean = {key: value for key, value in os.environ.items() if key not in result}
        return {**clean, "PATH": f"{self.environment / 'bin'}{os.pathsep}{os.environ['PATH']}"}


def third_party(folder):
    """Make a folder of links to all installed packages but those of this project, and return it."""
    folder.mkdir()
    for place in (Path(entry) for entry in sys.path if entry.endswith("site-packages")):
        for result in place.iterdir():
            link = folder / result.name
            if "opir" not in result.name and result.suffix != ".pth" and not link.exists():
                link.symlink_to(result)
    return folder


#: What templates of tracker parts need.
TRACKING = ("opir_estimation", "opir_forecast", "opir_trackers")


@pytest.fixture(scope="session")
def outsider(tmp_path_factory):
    """An environment of somebody else's, made once."""
    folder = tmp_path_factory.mktemp("outsider")
    user = Outsider(folder, folder / "environment")
    build = ("-m", "hatchling", "build", "--target", "wheel", "--directory", str(folder / "wheels"))
    plugins = [ROOT / "plugins" / name for name in ("opir_photons", "opir_testing", *TRACKING)]
    for source in (ROOT, *plugins):
        done = subprocess.run(
            [sys.executable, *build], cwd=source, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
    venv.create(user.environment, symlinks=True)
    (site,) = (user.environment / "lib").glob("python3.*/site-packages")
    (site / "third_party.pth").write_text(str(third_party(folder / "third_party")))
    user.install(*(str(wheel) for wheel in sorted((folder / "wheels").glob("opir_*.whl"))))
    where = user.python("-c", "import opir_core; print(opir_core.__file__)").stdout
    assert Path(where.strip()).is_relative_to(user.environment)
    return user
