"""The AsyncAPI document of the topic, as AsyncAPI's own parser reads it."""

import json
import shutil
import subprocess
from pathlib import Path

import npm_packages
import pytest
import yaml
from opir_kafka.document import asyncapi_text

pytestmark = pytest.mark.slow

SOURCES = Path(__file__).parents[1] / "support" / "asyncapi"


@pytest.fixture(scope="module")
def parser():
    folder = npm_packages.installed(SOURCES, "AsyncAPI's parser")
    shutil.copy(SOURCES / "errors.mjs", folder)
    return folder


def errors_of(parser, path):
    words = ["node", "errors.mjs", str(path)]
    done = subprocess.run(
        words, cwd=parser, capture_output=True, text=True, timeout=120, check=False
    )
    return done.returncode, json.loads(done.stdout)


def test_the_parser_reads_the_document_without_errors(parser, tmp_path):
    path = tmp_path / "asyncapi.yaml"
    path.write_text(asyncapi_text(), encoding="utf-8")
    assert errors_of(parser, path) == (0, [])


def test_the_parser_finds_a_reference_that_leads_nowhere(parser, tmp_path):
    document = yaml.safe_load(asyncapi_text())
    del document["components"]["messages"]["forge"]["payload"]["schema"]["$defs"]["point"]
    path = tmp_path / "asyncapi.yaml"
    path.write_text(yaml.safe_dump(document), encoding="utf-8")
    code, errors = errors_of(parser, path)
    assert code == 1
    assert any("$defs/point" in error for error in errors)
