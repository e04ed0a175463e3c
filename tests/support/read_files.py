"""Files of other programs, read as users do: by the readers of the installed plugins."""

from collections.abc import Mapping
from typing import Any, get_args

import pytest
from attrs import fields_dict

from opir_core.plugin import BadFileError, FileReader, Host, ReaderContext

READERS: tuple[FileReader, ...] = tuple(Host.discover().readers())
READER: Mapping[str, FileReader] = {reader.name: reader for reader in READERS}

#: 2026-04-01T12:00:00Z, microseconds of UTC since 1970.
EPOCH_US = 1_775_044_800_000_000


def read(name: str, text: str, epoch_us: int = EPOCH_US, **settings: Any) -> Any:
    """Return the content of a text by the reader of a name; `site` is a mapping."""
    reader = READER[name]
    if settings.get("site") is not None:
        site, _ = get_args(fields_dict(reader.config)["site"].type)
        settings["site"] = site(**settings["site"])
    return reader.build(reader.config(**settings), ReaderContext(text=text, epoch_us=epoch_us))


def recognised(text: str) -> list[str]:
    """Return the names of the readers that recognise a text."""
    return [reader.name for reader in READERS if reader.recognises(text)]


def refusal(name: str, text: str, epoch_us: int = EPOCH_US, **settings: Any) -> str:
    """Return why the reader of a name refuses a text."""
    with pytest.raises(BadFileError) as refused:
        read(name, text, epoch_us, **settings)
    return str(refused.value)
