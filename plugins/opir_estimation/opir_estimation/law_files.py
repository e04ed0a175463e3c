"""Parameters of laws, which stand in data files with their units, reasons and sources."""

import json
from importlib.resources import files
from types import SimpleNamespace
from typing import Any


def law_parameters(package: str, name: str) -> Any:
    """Return the parameters of a law as attributes: the `value` of each entry of `laws/NAME.json`.

    The file lies in a folder of `package`. Each entry has a `unit`, a `reason` and a `source` too.
    """
    text = files(package).joinpath("laws", f"{name}.json").read_text("utf-8")
    return SimpleNamespace(**{key: entry["value"] for key, entry in json.loads(text).items()})
