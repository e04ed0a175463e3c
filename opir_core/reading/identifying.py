"""Blocks that stand for one thing: its id, its model and the model's settings."""

import re

from opir_core.reading.choosing import Chooser, Settings, component_name
from opir_core.reading.limits import MAXIMUM_ID_LENGTH
from opir_core.reading.nodes import Gathering, Node, shown_text, under
from opir_core.reading.readers import block_of, read_text
from opir_core.reading.structuring import required
from opir_core.scene import Choice

_ID = re.compile(rf"[A-Za-z0-9._:-]{{1,{MAXIMUM_ID_LENGTH}}}")


#: What an id is, in words.
ID_RULE = f"ids have 1 to {MAXIMUM_ID_LENGTH} characters, of A to Z, a to z, 0 to 9 and ._:-"


class Identifier:
    """Reads blocks of `id`, `model` and settings, for one kind of thing; no id is given twice."""

    def __init__(self, chooser: Chooser, hook: str, default_model: str | None = None) -> None:
        self.chooser = chooser
        self.hook = hook
        self._default_model = default_model
        self._homes: dict[str, str] = {}

    def identified(self, node: Node, path: str, other_keys: tuple[str, ...], choice_path: str) -> tuple[str, Choice]:
        """Return a block's id and its model; `choice_path` is the path that the model goes by."""
        settings = dict(block_of(node, other_keys))
        gathering = Gathering()
        with gathering.at(".id"):
            found = required(settings, "id", node)
            given_id = self.claimed(read_text(found), path, found)
        with gathering.at():
            name = self._model(settings, node)
            choice = self.chooser.choice(self.hook, name, choice_path, Settings(node, settings, other_keys=other_keys))
        gathering.require_whole()
        return given_id, choice

    def claimed(self, text: str, path: str, node: Node) -> str:
        """Return an id, which is `path`'s from there on; raises `Refused` for a text that is none or is taken."""
        if not is_id(text):
            raise node.refused(f"{shown_text(text)} is not an id; {ID_RULE}")
        home = self._homes.setdefault(text, path)
        if home != path:
            raise node.refused(f"{text} is the id of {home} already")
        return text

    def _model(self, settings: dict[str, Node], node: Node) -> str:
        if "model" not in settings and self._default_model is not None:
            return self._default_model
        with under(".model"):
            return component_name(required(settings, "model", node))


def is_id(text: object) -> bool:
    """Return whether a value may be the id of a sensor or a target."""
    return isinstance(text, str) and _ID.fullmatch(text) is not None
