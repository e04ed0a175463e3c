"""Scenes that come with opir."""

from collections.abc import Sequence
from pathlib import Path

from opir_core.errors import Problem, SceneError
from opir_core.host.host import Host
from opir_core.reading.loading import load_scene
from opir_core.scene.scene import Scene

_PACKAGE = Path(__file__).parent.parent


def example(name: str = "", *, overrides: Sequence[str] = (), host: Host | None = None) -> Scene:
    """Return a scene that comes with opir, by its name or the beginning of it.

    `overrides` and `host` are those of `load_scene`. Raises `SceneError` with all names for another
    one, or none.

    >>> import opir_core as opir
    >>> opir.example("first").duration_s
    270.0
    """
    # An editable installation has the folder of the repository.
    folders = (_PACKAGE / "examples", _PACKAGE.parent / "examples")
    files = {path.stem: path for folder in folders for path in sorted(folder.glob("*.yaml"))}
    names = [stem for stem in files if stem.startswith(name.replace("-", "_"))]
    if len(names) != 1:
        words = f"{name!r} is not the name of one; there are {', '.join(files)}"
        raise SceneError([Problem("", words)], source="example")
    return load_scene(files[names[0]], overrides=overrides, host=host)
