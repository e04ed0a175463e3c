"""Pipes, sockets, devices and folders are refused at once where a user must name a file: nothing
waits for them.
"""

import os
import socket
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from opir_photons.radiometry.emitters import rows_of_csv
from opir_photons.radiometry.source_configs import FireConfig
from scene_reading import HOST, PAGE

from opir_core.errors import OpirError
from opir_core.orbits import OmmFileConfig
from opir_core.orbits.orbit_models import omm_of_file
from opir_core.reading import load_scene
from opir_core.scene import NotAFileError, file_bytes

pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs POSIX pipes")


@pytest.fixture
def odd() -> Iterator[dict[str, Path]]:
    """Give a pipe that nobody writes into, a socket, a device and a folder; a socket needs a short
    path.
    """
    with TemporaryDirectory() as name, socket.socket(socket.AF_UNIX) as bound:
        folder = Path(name)
        os.mkfifo(folder / "pipe")
        bound.bind(str(folder / "socket"))
        yield {
            "a pipe (FIFO)": folder / "pipe",
            "a socket": folder / "socket",
            "a device": Path("/dev/zero"),
            "": folder,
        }


READERS: dict[str, Callable[[Path], object]] = {
    "scene": lambda path: load_scene(path, host=HOST),
    "omm": lambda path: omm_of_file(OmmFileConfig(path=str(path))),
    "emitters": lambda path: rows_of_csv(str(path), FireConfig(csv=str(path)), "sources[0]"),
}


@pytest.mark.parametrize("what", ["a pipe (FIFO)", "a socket", "a device", ""])
@pytest.mark.parametrize("reader", sorted(READERS))
def test_what_is_no_file_is_refused_by_every_reader(
    reader: str, what: str, odd: dict[str, Path]
) -> None:
    words = f"it is {what}; write its content to a file" if what else "(?i)is a directory"
    with pytest.raises(OpirError, match=words.replace("(FIFO)", r"\(FIFO\)")):
        READERS[reader](odd[what])


def test_a_file_replaced_by_a_pipe_does_not_block(
    odd: dict[str, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    regular = Path(__file__).stat()
    monkeypatch.setattr(Path, "stat", lambda _path, **_more: regular)
    with pytest.raises(NotAFileError, match="a pipe"):
        file_bytes(odd["a pipe (FIFO)"])


def test_no_more_is_read_than_is_asked_for(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"x" * 100)
    assert file_bytes(tmp_path / "file", 10) == b"x" * 11
    assert file_bytes(tmp_path / "file") == b"x" * 100


def test_a_symbolic_link_to_a_scene_is_a_scene(tmp_path: Path) -> None:
    (tmp_path / "scene.yaml").write_text(PAGE)
    (tmp_path / "link.yaml").symlink_to("scene.yaml")
    assert load_scene(tmp_path / "link.yaml", host=HOST) == load_scene(
        tmp_path / "scene.yaml", host=HOST
    )
