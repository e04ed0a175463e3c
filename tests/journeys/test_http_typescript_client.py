"""Types that openapi-typescript generates from the OpenAPI document, and a program that reads a
service with them.
"""

import json
import shutil
import subprocess
from pathlib import Path

import npm_packages
import pytest
from http_service import serving
from opir_http.routes import document

pytestmark = pytest.mark.slow

SOURCES = Path(__file__).parents[1] / "support" / "typescript"
#: Declares the two names of node that the program uses, in place of the types of all of node.
NODE = "declare const process: { argv: string[] };\n"
CHECKED = (
    "--strict",
    "--target",
    "es2022",
    "--module",
    "nodenext",
    "--types",
    "--lib",
    "es2022,dom",
)


@pytest.fixture(scope="module")
def modules():
    """Return the folder `node_modules` with the generator and the compiler; npm installs them
    once.
    """
    return npm_packages.installed(SOURCES, "the TypeScript client") / "node_modules"


def run(folder, *words):
    done = subprocess.run(
        words, cwd=folder, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture
def program(modules, tmp_path):
    """Return a folder with the program and the types that are generated for it."""
    shutil.copy(SOURCES / "reads.ts", tmp_path)
    (tmp_path / "package.json").write_text('{"type": "module"}')
    (tmp_path / "node.d.ts").write_text(NODE)
    (tmp_path / "openapi.json").write_text(json.dumps(document()), encoding="utf-8")
    run(
        tmp_path,
        "node",
        f"{modules}/openapi-typescript/bin/cli.js",
        "openapi.json",
        "--output",
        "opir.d.ts",
    )
    return tmp_path


def test_a_typed_program_reads_a_service(modules, program):
    run(program, "node", f"{modules}/typescript/bin/tsc", *CHECKED, "reads.ts", "node.d.ts")
    with serving(program) as stand:
        result = json.loads(run(program, "node", "reads.js", f"http://127.0.0.1:{stand.port}"))
    assert result["state"] in {"starting", "running"}
    assert result["launched"] >= 1
    assert isinstance(result["places"], list)


def test_a_name_that_is_not_in_the_document_is_an_error(modules, program):
    source = program / "reads.ts"
    source.write_text(source.read_text().replace("targets_launched", "targets_flown"))
    words = ("node", f"{modules}/typescript/bin/tsc", *CHECKED, "--noEmit", "reads.ts", "node.d.ts")
    done = subprocess.run(
        words, cwd=program, capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode
    assert "Property 'targets_flown' does not exist" in done.stdout
