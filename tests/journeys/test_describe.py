"""`opir describe`: what a scene may set of a component, from the same fields that read the
scene.
"""

import json
import subprocess
import sys

import pytest
from attrs import fields
from repository import EXAMPLES

from opir_core.host.components import Component
from opir_core.host.host import Host


def opir(*words):
    return subprocess.run(
        [sys.executable, "-m", "opir_core", *words], capture_output=True, text=True, check=False
    )


def test_text_has_every_field_with_unit_range_default_meaning_and_source():
    done = opir("describe", "weighted")
    assert done.returncode == 0
    assert done.stdout.splitlines()[:2] == [
        "confidence model weighted, of opir-core 0.1.0 (plugin builtin)",
        "weighted sum of confirming bands, number of detections and elevation (the paper's)",
    ]
    assert (
        "band: number, [0, 1], default 0.4\n    weight of the fraction of bands that confirm\n   "
        " default: opir-" in (done.stdout)
    )


def test_json_of_every_component_of_the_core_has_every_field():
    from opir_core.cli.components import HOOK_BY_KIND, components_named, described

    host = Host.of()
    for kind, hook in HOOK_BY_KIND.items():
        for name in host.names(hook):
            (owned,) = components_named(host, name, kind)
            reported = json.loads(
                json.dumps(described(owned.component, owned.owner), allow_nan=False)
            )
            if hook == "opir_target_classes":
                continue
            assert isinstance(owned.component, Component)
            top_level = [row["key"] for row in reported["fields"] if "." not in row["key"]]
            assert top_level == [attribute.name for attribute in fields(owned.component.config)]
            assert all(row["help"] for row in reported["fields"])


def test_a_name_of_several_kinds_is_reported_of_each():
    everyone = json.loads(opir("describe", "always", "--json").stdout)
    assert [reported["kind"] for reported in everyone] == [
        "detection model",
        "confidence model",
        "classifier",
    ]
    (description,) = json.loads(opir("describe", "always", "--kind", "classifier", "--json").stdout)
    assert description["kind"] == "classifier"


def test_a_constellation_has_its_satellites():
    (reported,) = json.loads(opir("describe", "DSP", "--kind", "constellation", "--json").stdout)
    assert reported["model"] == "DSP"
    assert [row["id"] for row in reported["satellites"]] == ["DSP-1", "DSP-2", "DSP-3", "DSP-4"]


@pytest.mark.slow
@pytest.mark.parametrize("words", [["wieghted"], ["wieghted", "--kind", "confidence-model"]])
def test_a_name_that_is_not_there_is_reported_with_the_nearest(words):
    done = opir("describe", *words)
    assert done.returncode == 3
    assert "nearest: weighted" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_missing_setting_is_reported_with_what_it_is_to_hold(tmp_path):
    scene = EXAMPLES / "first_light.yaml"
    text = scene.read_text(encoding="utf-8").replace("lat_deg: ", "lat_dge: ", 1)
    (tmp_path / "scene.yaml").write_text(text, encoding="utf-8")
    done = opir("validate", str(tmp_path / "scene.yaml"))
    assert "lat_deg: is missing: geodetic latitude (WGS 84), deg, [-90, 90]" in done.stderr


def test_listing_plugins_imports_no_numpy():
    code = (
        "from opir_core.cli.main import main; import sys; main(['plugins', '--json']);"
        " sys.exit('numpy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0
    assert {row["plugin"] for row in json.loads(done.stdout)} >= {"builtin", "dsp"}
