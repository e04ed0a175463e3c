"""`opir new-plugin`: what it writes installs beside a wheel, passes its contract and runs its
scene, at once.
"""

import ast
import json
import re
from importlib import import_module

import pytest
from opir_testing.commands.new_plugin import KINDS
from repository import EXAMPLES

from opir_core.cli.main import main
from opir_core.host.components import CATALOGUE

NAMES = {kind: f"brand-new-{kind}" for kind in KINDS}

#: Kinds that work on files, on finished runs, or on many: no scene chooses one.
OF_STUDIES = ("reader", "metric", "executor", "exporter", "view")


@pytest.fixture
def opir(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def run(*words):
        code = main(words)
        return (code, *capsys.readouterr())

    return run


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_package_has_what_a_package_needs_and_no_placeholder_left(opir, tmp_path, kind):
    code, out, _ = opir("new-plugin", kind, "my-part")
    assert code == 0
    written = sorted(path.name for path in (tmp_path / "my-part").iterdir())
    assert written == ["README.md", "my_part.py", "pyproject.toml", "scene.yaml", "test_my_part.py"]
    assert out.splitlines()[:5] == [f"my-part/{name}" for name in out_order(written)]
    for name in written:
        text = (tmp_path / "my-part" / name).read_text(encoding="utf-8")
        assert "$" not in text.replace("$ ", ""), name


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_what_a_package_imports_is_public_and_there(opir, tmp_path, kind):
    opir("new-plugin", kind, "my-part")
    for name in ("my_part.py", "test_my_part.py"):
        tree = ast.parse((tmp_path / "my-part" / name).read_text(encoding="utf-8"))
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module.startswith("opir_core"):
                public = import_module(node.module).__all__
                assert {alias.name for alias in node.names} <= set(public)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_the_name_stands_once_in_the_code(opir, tmp_path, kind):
    opir("new-plugin", kind, "my-part")
    code = (tmp_path / "my-part" / "my_part.py").read_text(encoding="utf-8")
    assert re.findall(r".*my.part.*", code, re.IGNORECASE) == ['NAME = "my-part"']


def test_every_kind_of_component_has_a_template():
    without = {"opir_renderers"}  # a faster renderer is compiled code, which no template brings
    assert {f"opir_{kind.hook}" for kind in KINDS.values()} == set(CATALOGUE) - without


def out_order(names):
    return sorted(
        names,
        key=["pyproject.toml", "README.md", "my_part.py", "scene.yaml", "test_my_part.py"].index,
    )


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("sensor", "My-Sensor"), "small letters, digits and single hyphens"),
        (("sensor", "9lives"), "begin with a letter, like my-sensor"),
        (("sensor", "../up"), "small letters"),
        (("sensor", "a" * 41), "at most 40"),
        (("sensor", "my--sensor"), "single hyphens"),
        (("sink", "json"), "json is a keyword or standard module of Python"),
        (("sink", "class"), "class is a keyword or standard module of Python"),
        (("sink", "numpy"), "a module numpy is installed"),
        (("tracker", "none"), "opir-core 0.1.0 (plugin builtin) offers a component of that name"),
        (("tracker", "dsp"), "a plugin of that name is installed"),
    ],
)
def test_a_name_that_cannot_be_is_reported_why(opir, tmp_path, words, reason):
    code, _, reported = opir("new-plugin", *words)
    assert code == 3
    assert f"cannot be named {words[1]!r}" in reported
    assert reason in reported
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_overwritten(opir, tmp_path):
    (tmp_path / "my-part").mkdir()
    (tmp_path / "my-part" / "mine").touch()
    code, _, reported = opir("new-plugin", "sink", "my-part")
    assert code == 3
    assert "my-part exists, and nothing is overwritten" in reported
    assert [path.name for path in (tmp_path / "my-part").iterdir()] == ["mine"]


def test_a_place_that_cannot_be_written_is_reported(opir, tmp_path):
    (tmp_path / "file").touch()
    code, _, reported = opir("new-plugin", "sink", "my-part", "--into", "file/below")
    assert code == 3
    assert "cannot be written: Not a directory" in reported


@pytest.fixture(scope="session")
def packages(outsider, tmp_path_factory):
    """A package of each kind, written by the wheel's `opir` and installed beside it.

    Made once per process, as `outsider` is: with `--dist=worksteal` a worker may come back to a
    module, and `opir` does not write a package whose name is installed.
    """
    folder = tmp_path_factory.mktemp("packages")
    for kind, name in NAMES.items():
        done = outsider.opir("new-plugin", kind, name, cwd=folder)
        assert done.returncode == 0, done.stderr
    outsider.install(*(f"./{name}" for name in NAMES.values()), cwd=folder)
    return folder


@pytest.mark.slow
def test_each_kind_installs_and_passes_its_contract(outsider, packages):
    done = outsider.python(
        "-m", "pytest", "-q", "-p", "no:cacheprovider", *NAMES.values(), cwd=packages
    )
    assert done.returncode == 0, done.stdout
    assert "passed" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_runs_its_scene(outsider, packages, kind, tmp_path):
    done = outsider.opir("run", str(packages / NAMES[kind] / "scene.yaml"), "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    reported = json.loads(done.stdout)
    assert reported["counts"]["detections"] > 100
    if kind == "sink":
        lines = (tmp_path / f"{NAMES[kind]}.csv").read_text(encoding="utf-8").splitlines()
        assert len(lines) == 1 + reported["counts"]["detections"]
    elif kind not in OF_STUDIES:
        manifest = json.loads((tmp_path / "events.manifest.json").read_text(encoding="utf-8"))
        assert NAMES[kind] in {row["distribution"] for row in manifest["components"]}


@pytest.mark.slow
def test_installed_plugins_are_listed_with_the_api_they_declare(outsider, packages):
    rows = {
        row["plugin"]: row
        for row in json.loads(outsider.opir("plugins", "--json", cwd=packages).stdout)
    }
    for name in NAMES.values():
        assert (rows[name]["distribution"], rows[name]["requires_core"], rows[name]["state"]) == (
            name,
            ">=0.1,<0.2",
            "ready",
        )
        assert [component["name"] for component in rows[name]["components"]] == [name]


MINIMAL = EXAMPLES / "minimal_plugin"


def test_the_minimal_plugin_is_minimal():
    assert (
        sum(
            len(path.read_text(encoding="utf-8").splitlines())
            for path in MINIMAL.iterdir()
            if path.is_file()
        )
        <= 60
    )


@pytest.mark.slow
def test_the_minimal_plugin_installs_beside_the_wheel_and_runs(outsider, tmp_path):
    copied = tmp_path / "minimal_plugin"
    copied.mkdir()
    for path in MINIMAL.glob("*.*"):
        (copied / path.name).write_bytes(path.read_bytes())
    outsider.install("./minimal_plugin", cwd=tmp_path)
    done = outsider.opir("run", "minimal_plugin/scene.yaml", "--quiet", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    events = [
        json.loads(line)
        for line in (tmp_path / "events.jsonl").read_text(encoding="utf-8").splitlines()
    ]
    assert [round(event["confidence"], 6) for event in events[4::5]][:2] == [0.5, 0.75]
