"""Fake distributions for the plugin host: real metadata and modules in a folder of their own on
`sys.path`.
"""

import sys
import sysconfig
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from textwrap import dedent, indent

import pytest

from opir_core.errors import PluginError
from opir_core.host import discovery
from opir_core.host.components import PluginFailure, Provenance
from opir_core.plugin import DetectionModel, Host, NoConfig, hookimpl

#: What plugins here import: no `*`, which would import numpy.
HEADER = (
    "from attrs import frozen\n"
    "from opir_core.plugin import AtmosphereModel, Constellation, DetectionModel, EventEncoder,"
    " NoConfig, SensorModel,"
    " SinkModel, TrackerModel, hookimpl, number\n"
)


class Shop:
    """Installs fake distributions below a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def install(
        self,
        plugin: str,
        code: str = "",
        *,
        version: str = "1.0",
        distribution: str = "",
        advertise: Sequence[str] = (),
        entry_points: Mapping[str, Mapping[str, str]] | None = None,
        requires: Sequence[str] = (),
        on_path: bool = True,
    ) -> Path:
        """Write a distribution with one module, `opir_PLUGIN.plugin`, and put its folder first on
        the path.
        """
        distribution = distribution or f"opir-{plugin}"
        package = distribution.replace("-", "_")
        folder = self.folder / f"{package}-{version}"
        module = f"{package}.plugin"
        (folder / package).mkdir(parents=True)
        (folder / package / "__init__.py").touch()
        (folder / package / "plugin.py").write_text(HEADER + dedent(code))
        groups = {"opir": {plugin: module}, "opir.components": dict.fromkeys(advertise, module)}
        write_metadata(
            folder,
            distribution,
            version,
            groups if entry_points is None else entry_points,
            requires,
        )
        if on_path:
            sys.path.insert(0, str(folder))
        return folder


def write_metadata(
    folder: Path,
    name: str,
    version: str,
    groups: Mapping[str, Mapping[str, str]],
    requires: Sequence[str] = (),
) -> None:
    info = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    headers = ["Metadata-Version: 2.3", f"Name: {name}", f"Version: {version}"]
    headers += [f"Requires-Dist: {requirement}" for requirement in requires]
    (info / "METADATA").write_text("\n".join([*headers, "", "Name: not-this", ""]))
    lines = [
        line
        for group, entries in groups.items()
        if entries
        for line in (f"[{group}]", *(f"{entry} = {value}" for entry, value in entries.items()), "")
    ]
    (info / "entry_points.txt").write_text("\n".join(lines))


def tracker_code(*names: str) -> str:
    """Return a plugin that offers trackers."""
    yields = "\n".join(
        f'yield TrackerModel(name="{name}", summary="a tracker", build=print)' for name in names
    )
    return f"@hookimpl\ndef opir_trackers():\n{indent(yields, '    ')}\n"


@pytest.fixture
def shop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Shop]:
    """A shop that nothing installed on this machine is seen beside; core's own plugin is a stub."""
    standard = {sysconfig.get_path(name) for name in ("stdlib", "platstdlib")}
    standard.add(str(Path(sysconfig.get_path("platstdlib")) / "lib-dynload"))
    monkeypatch.setattr(sys, "path", [entry for entry in sys.path if entry in standard])
    monkeypatch.delenv("OPIR_PLUGINS", raising=False)
    monkeypatch.setitem(sys.modules, "opir_core.builtin.plugin", stub_builtin())
    monkeypatch.setattr(discovery, "CORE_PLUGINS", {"builtin": discovery.CORE_PLUGINS["builtin"]})
    for name in [
        name
        for name in sys.modules
        if name.startswith("opir_") and name.partition(".")[0] != "opir_core"
    ]:
        monkeypatch.delitem(sys.modules, name)
    yield Shop(tmp_path)
    forget(str(tmp_path))


@pytest.fixture
def trackers() -> Callable[..., str]:
    return tracker_code


@pytest.fixture
def assert_left_out(shop: Shop, caplog: pytest.LogCaptureFixture) -> Callable[[str, str], None]:
    """Return a check that a plugin's code fails for a reason, whether it advertises or not."""

    def check(code: str, reason: str) -> None:
        failure = f"opir-bad 3.1 (plugin bad): {reason}"
        shop.install("good", tracker_code("kalman"))
        shop.install("bad", code, version="3.1")
        assert_costs_only_itself(reason)
        assert caplog.messages == [f"plugin left out: {failure}"]
        assert [(record.name, record.levelname) for record in caplog.records] == [
            ("opir", "WARNING")
        ]
        forget(sys.path.pop(0))
        Shop(shop.folder / "again").install("bad", code, version="3.1", advertise=["trackers.arc"])
        assert_advertised_name_is_refused(failure)

    return check


def assert_costs_only_itself(reason: str) -> None:
    host = Host.discover()
    assert host.component("opir_trackers", "kalman").name == "kalman"
    assert host.names("opir_trackers") == ["kalman"]
    assert host.failures == (PluginFailure(Provenance("bad", "opir-bad", "3.1"), reason),)
    with pytest.raises(PluginError) as error:
        host.component("opir_trackers", "arc", "tracker")
    assert str(error.value) == (
        "tracker: no tracker is named 'arc'\n"
        "  trackers installed: kalman of opir-good 1.0 (plugin good)\n"
        f"  failed: opir-bad 3.1 (plugin bad): {reason}"
    )


def assert_advertised_name_is_refused(failure: str) -> None:
    host = Host.discover()
    assert host.names("opir_trackers") == ["arc", "kalman"]
    assert host.failures == ()
    with pytest.raises(PluginError) as error:
        host.component("opir_trackers", "arc", "tracker")
    assert str(error.value) == (
        f"tracker: the tracker 'arc' cannot be used, because its plugin failed\n  failed: {failure}"
    )
    assert host.names("opir_trackers") == ["kalman"]


def forget(folder: str) -> None:
    files = {name: getattr(module, "__file__", None) or "" for name, module in sys.modules.items()}
    for name in [name for name, file in files.items() if file.startswith(folder)]:
        del sys.modules[name]


@pytest.fixture
def metadata_of() -> Callable[..., None]:
    return write_metadata


def stub_builtin() -> types.ModuleType:
    module = types.ModuleType("opir_core.builtin.plugin")

    @hookimpl
    def opir_detection_models() -> list[DetectionModel]:
        return [
            DetectionModel(name="constant", summary="always the same", config=NoConfig, build=print)
        ]

    module.opir_detection_models = opir_detection_models  # type: ignore[attr-defined]
    return module
