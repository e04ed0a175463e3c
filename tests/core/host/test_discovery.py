"""Which plugins a host sees: what the metadata say, what `OPIR_PLUGINS` allows, and in no order but
that of names.
"""

import itertools
import sys
import zipfile
from importlib import metadata

import pytest

from opir_core import __version__
from opir_core.errors import PluginError
from opir_core.host.components import CATALOGUE
from opir_core.host.contributions import HOOKS
from opir_core.host.discovery import distributions_with
from opir_core.host.hookspecs import CatalogueHooks, ExtensionHooks
from opir_core.host.registry import ComponentRow, PluginRow
from opir_core.plugin import Host


def states(host):
    return {row.plugin: row.state for row in host.catalogue()}


def owners(host):
    return {str(failure.provenance) for failure in host.failures}


@pytest.mark.parametrize("group", ["console_scripts", "pytest11", "no.such.group"])
def test_distributions_agree_with_importlib_metadata(group):
    expected = {
        (point.dist.name, point.dist.version, point.name, point.value)
        for point in metadata.entry_points(group=group)
    }
    entry_points = {
        (distribution.name, distribution.version, name, value)
        for distribution in distributions_with((group,))
        for name, value in distribution.entry_points[group]
    }
    assert entry_points == expected
    assert bool(entry_points) == (group != "no.such.group")


def test_every_hook_is_specified_once():
    specified = [
        name
        for spec in (CatalogueHooks, ExtensionHooks)
        for name in vars(spec)
        if name.startswith("opir_")
    ]
    assert sorted(specified) == sorted(HOOKS)
    assert set(CATALOGUE) < set(HOOKS)


def test_the_catalogue_of_the_core(shop):
    constant = ComponentRow(
        hook="opir_detection_models",
        kind="detection model",
        name="constant",
        summary="always the same",
    )
    assert Host.discover().catalogue() == [
        PluginRow(
            distribution="opir-core",
            version=__version__,
            plugin="builtin",
            state="ready",
            components=(constant,),
        )
    ]


def test_discovery_imports_nothing(shop, trackers):
    shop.install("one", trackers("kalman"))
    shop.install("two", trackers("arc"), advertise=["trackers.arc"])
    Host.discover()
    assert not {"opir_one", "opir_two"} & set(sys.modules)


def test_the_first_of_two_installations_counts(shop, trackers):
    folder = shop.install("one", trackers("old"), version="1.0")
    (folder / "opir_one-1.0.dist-info").rename(folder / "Opir.One-1.0.dist-info")
    shop.install("one", trackers("new"), version="2.0")
    host = Host.discover()
    assert host.names("opir_trackers") == ["new"]
    assert str(host.provenance("opir_trackers", "new")) == "opir-one 2.0 (plugin one)"


def test_the_canonical_name_tells_distributions_apart(shop, metadata_of, tmp_path):
    for name in ("Opir_One", "opir.one", "opir-two"):
        metadata_of(tmp_path / name, name, "1.0", {"opir": {"x": "x"}})
        sys.path.append(str(tmp_path / name))
    assert [distribution.name for distribution in distributions_with(("opir",))] == [
        "Opir_One",
        "opir-two",
    ]


def test_plugins_in_an_archive(shop, trackers, tmp_path):
    folder = shop.install("zipped", trackers("kalman"), on_path=False)
    with zipfile.ZipFile(tmp_path / "zipped.whl", "w") as archive:
        for path in folder.rglob("*"):
            archive.write(path, path.relative_to(folder))
    sys.path.insert(0, str(tmp_path / "zipped.whl"))
    assert (
        str(Host.discover().provenance("opir_trackers", "kalman"))
        == "opir-zipped 1.0 (plugin zipped)"
    )


def test_plugins_that_only_a_finder_knows(shop, trackers, tmp_path, monkeypatch):
    folder = shop.install("found", trackers("kalman"))
    info = next(folder.glob("*.dist-info"))
    hidden = tmp_path / "elsewhere" / info.name
    hidden.parent.mkdir()
    info.rename(hidden)

    class Finder:
        def find_spec(self, name, path=None, target=None):
            return None

        def find_distributions(self, context):
            yield metadata.Distribution.at(hidden)

    assert "found" not in states(Host.discover())
    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path, Finder()])
    assert (
        str(Host.discover().provenance("opir_trackers", "kalman"))
        == "opir-found 1.0 (plugin found)"
    )


@pytest.mark.parametrize(
    "text", [b"", b"\xff\xfe[opir]\x00", b"[opir]\nnonsense\n", b"x = y\n[opir", b"[]\n=\n"]
)
def test_damaged_metadata_of_a_neighbour(shop, trackers, text):
    shop.install("good", trackers("kalman"))
    folder = shop.install("odd")
    next(folder.glob("*.dist-info/entry_points.txt")).write_bytes(text)
    host = Host.discover()
    assert host.names("opir_trackers") == ["kalman"]
    assert states(host) == {"builtin": "ready", "good": "ready"}


def test_a_distribution_without_a_name_is_called_as_its_folder(shop):
    folder = shop.install("nameless", "1 / 0")
    next(folder.glob("*.dist-info/METADATA")).unlink()
    host = Host.discover()
    host.catalogue()
    assert owners(host) == {"opir_nameless 1.0 (plugin nameless)"}


def test_comments_and_blanks_in_entry_points(shop, trackers):
    folder = shop.install("good", trackers("kalman"))
    text = "\n# a comment = here\n[ opir ]\n  good   =opir_good.plugin  \n[other]\nbad = opir_bad\n"
    next(folder.glob("*.dist-info/entry_points.txt")).write_text(text)
    assert states(Host.discover()) == {"builtin": "ready", "good": "ready"}


def test_an_entry_point_written_twice_is_one_plugin(shop, trackers):
    folder = shop.install("good", trackers("kalman"))
    text = "[opir]\ngood = opir_good.plugin\ngood = opir_good.plugin\n"
    next(folder.glob("*.dist-info/entry_points.txt")).write_text(text)
    assert Host.discover().provenance("opir_trackers", "kalman").plugin == "good"


class TestAllowList:
    @pytest.fixture(autouse=True)
    def installed(self, shop, trackers):
        shop.install("kafka", trackers("kalman"))
        shop.install("dsp", trackers("arc"), advertise=["trackers.arc"])
        shop.install("heo", trackers("mht"))

    def test_unset_allows_all(self):
        assert states(Host.discover()) == {
            "builtin": "ready",
            "dsp": "ready",
            "heo": "ready",
            "kafka": "ready",
        }

    def test_none_allows_all_whatever_the_variable_says(self, monkeypatch):
        monkeypatch.setenv("OPIR_PLUGINS", "dsp")
        assert set(states(Host.discover(None)).values()) == {"ready"}

    @pytest.mark.parametrize("value", ["dsp,kafka", " dsp , kafka,", "kafka,dsp,dsp,builtin"])
    def test_only_names_on_the_list_are_loaded(self, monkeypatch, value):
        monkeypatch.setenv("OPIR_PLUGINS", value)
        host = Host.discover()
        assert states(host) == {
            "builtin": "ready",
            "dsp": "ready",
            "kafka": "ready",
            "heo": "hidden",
        }
        assert host.names("opir_trackers") == ["arc", "kalman"]
        assert "opir_heo" not in sys.modules

    @pytest.mark.parametrize("value", ["", " ", ","])
    def test_an_empty_list_allows_only_the_core(self, monkeypatch, value):
        monkeypatch.setenv("OPIR_PLUGINS", value)
        host = Host.discover()
        assert states(host) == {
            "builtin": "ready",
            "dsp": "hidden",
            "heo": "hidden",
            "kafka": "hidden",
        }
        assert not {"opir_dsp", "opir_heo", "opir_kafka"} & set(sys.modules)

    def test_a_list_may_be_given_by_the_program(self, monkeypatch):
        monkeypatch.setenv("OPIR_PLUGINS", "kafka")
        assert Host.discover(["heo"]).names("opir_trackers") == ["mht"]
        assert Host.discover("dsp,heo").names("opir_trackers") == ["arc", "mht"]
        assert Host.discover([]).names("opir_trackers") == []

    def test_an_unknown_name_is_a_warning_and_a_row(self, monkeypatch, caplog):
        monkeypatch.setenv("OPIR_PLUGINS", "dsp,kafak,zzz")
        rows = Host.discover().catalogue()
        complaint = (
            "OPIR_PLUGINS names 'kafak', but no installed distribution has such a plugin; the"
            " nearest is 'kafka'"
        )
        second_complaint = (
            "OPIR_PLUGINS names 'zzz', but no installed distribution has such a plugin"
        )
        assert caplog.messages == [complaint, second_complaint]
        assert [row for row in rows if row.state == "unknown"] == [
            PluginRow(
                distribution="", version="", plugin="kafak", state="unknown", failure=complaint
            ),
            PluginRow(
                distribution="", version="", plugin="zzz", state="unknown", failure=second_complaint
            ),
        ]

    def test_a_missing_name_is_answered_with_what_is_hidden(self, monkeypatch):
        monkeypatch.setenv("OPIR_PLUGINS", "kafka,hoe")
        with pytest.raises(PluginError) as error:
            Host.discover().component("opir_trackers", "arc", "tracker")
        assert str(error.value) == (
            "tracker: no tracker is named 'arc'\n"
            "  trackers installed: kalman of opir-kafka 1.0 (plugin kafka)\n"
            "  opir-dsp 1.0 (plugin dsp) offers it, but OPIR_PLUGINS does not allow dsp\n"
            "  hidden, because OPIR_PLUGINS does not allow them: opir-dsp 1.0 (plugin dsp),"
            " opir-heo 1.0 (plugin heo)\n"
            "  OPIR_PLUGINS names 'hoe', but no installed distribution has such a plugin; the"
            " nearest is 'heo'"
        )

    def test_a_program_is_reported_of_its_own_list(self):
        with pytest.raises(
            PluginError, match="hidden, because the allow-list does not allow them: opir-dsp"
        ):
            Host.discover(["kafka"]).component("opir_trackers", "arc")


def test_the_order_of_installation_has_no_effect(shop, trackers, tmp_path):
    names = ["alpha", "beta", "gamma", "delta"]
    folders = [
        shop.install("alpha", trackers("b", "a")),
        shop.install("beta", trackers("c"), advertise=["trackers.c"]),
        shop.install("gamma", trackers("c", "x")),
        shop.install("delta", "1 / 0"),
    ]
    system_path = [entry for entry in sys.path if entry not in map(str, folders)]
    catalogues = set()
    for order in itertools.permutations(folders):
        sys.path[:] = [*map(str, order), *system_path]
        for plugin_name in names:
            sys.modules.pop(f"opir_{plugin_name}.plugin", None)
        host = Host.discover()
        answers = [host.component("opir_trackers", "b").name]
        for name in ("c", "absent"):
            with pytest.raises(PluginError) as error:
                host.component("opir_trackers", name, "tracker")
            answers.append(str(error.value))
        catalogues.add(
            (*answers, str(host.names("opir_trackers")), str(host.failures), str(host.catalogue()))
        )
    assert len(catalogues) == 1
    assert [row.plugin for row in Host.discover().catalogue()] == [
        "alpha",
        "beta",
        "builtin",
        "delta",
        "gamma",
    ]


OFFERING = """
class Offering:
    def __init__(self, *names):
        self.names = names
    @hookimpl
    def opir_trackers(self):
        return (TrackerModel(name=name, summary="a tracker", build=print) for name in self.names)
"""


@pytest.mark.parametrize("order", list(itertools.permutations(["first", "second", "third"])))
@pytest.mark.parametrize("names", list(itertools.permutations("abc")))
def test_the_order_of_entry_points_and_of_yielding_has_no_effect(shop, order, names):
    code = f"{OFFERING}\nfirst, second, third = Offering(*{names}), Offering('d'), Offering('e')"
    shop.install(
        "many", code, entry_points={"opir": {name: f"opir_many.plugin:{name}" for name in order}}
    )
    rows = [row for row in Host.discover().catalogue() if row.plugin != "builtin"]
    assert [(row.plugin, [component.name for component in row.components]) for row in rows] == [
        ("first", ["a", "b", "c"]),
        ("second", ["d"]),
        ("third", ["e"]),
    ]
