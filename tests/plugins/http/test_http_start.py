"""What the service says of its scene when it starts."""

import argparse
import json
from pathlib import Path

import pytest
from opir_http.arguments import add_arguments
from opir_http.serving import service_of, start_text

SCENE = {
    "scene": "start",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 5.0,
    "sensors": [{"constellation": "SBIRS-GEO"}],
    "targets": [],
}


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({}, "detection: constant, since the scene describes no light"),
        ({"background": "earth"}, "detection: snr, since the scene describes light: background"),
    ],
    ids=str,
)
def test_the_service_says_which_detection_was_chosen(
    changes: dict[str, str], line: str, tmp_path: Path
) -> None:
    path = tmp_path / "scene.yaml"
    path.write_text(json.dumps({**SCENE, **changes}))
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    service = service_of(parser.parse_args([str(path)]))
    text = start_text("localhost", 80, service.run.plan.scene.automatic)
    assert text.startswith("opir: http://localhost:80\n")
    assert text.endswith(f"\nopir: {line}\n")
