"""Sinks built as a scene builds them, and programs that write to them."""

import os
import subprocess
import sys

from opir_testing import stub_sensor

from opir_core.builtin.plugin import ENCODERS, SINKS
from opir_core.interfaces.contexts import EncoderContext, SinkContext


def encoder():
    return ENCODERS[0].build(
        ENCODERS[0].config(), EncoderContext(sensors=(stub_sensor(),), epoch_us=0)
    )


def sink(name, make_encoder=encoder, **config):
    (component,) = (model for model in SINKS if model.name == name)
    return component.build(
        component.config(**config), SinkContext(make_encoder=make_encoder, scene_name="stub")
    )


def python(program, *arguments):
    opening = (
        "import sys, os, signal\n"
        "from opir_core.builtin.sinks import LineFile\n"
        "from opir_core.errors import SinkError\n"
        "from opir_core.output.events.forge import ForgeEncoder\n"
        "from opir_core.interfaces.contexts import EncoderContext\n"
        "from opir_testing import stub_sensor\n"
        "from opir_testing.doubles import stub_window\n"
        "encoder = ForgeEncoder(EncoderContext(sensors=(stub_sensor(),), epoch_us=0))\n"
    )
    # As for a user: what is printed waits in Python's buffer.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    command = [sys.executable, "-c", opening + program, *arguments]
    return subprocess.run(command, capture_output=True, check=False, env=environment)
