"""Conformance tests of readers of files."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from opir_core.plugin import (
    FILE_CONTENTS,
    BadFileError,
    FileReader,
    ReaderContext,
    StateTable,
)
from opir_testing.contracts.contract import (
    Contract,
    require,
    require_no_outside_inputs,
)

#: Texts that no reader may take for its own, whichever format it reads.
_STRANGERS = {
    "a letter": "Dear reader,\nthis file holds nothing but a few words.\n",
    "a picture": "<svg xmlns='http://www.w3.org/2000/svg'/>\n",
    "a page": "<!doctype html><html><body></body></html>\n",
}

#: Distance from the Earth's centre that no ground has: 50 km below the poles, m.
_INSIDE_M = 6_307_000.0

_ALONE = "Compute everything from the text that is passed: no clock, no network, no random numbers."


class ReaderContract(Contract):
    """Conformance tests of a reader; they read its `example`."""

    kind = FileReader

    @classmethod
    def read(cls, text: str) -> Any:
        """Return what the reader makes of a text."""
        return cls.component().build(cls.config(), ReaderContext(text=text))

    @classmethod
    def part(cls) -> Any:
        """Return what the reader makes of its example."""
        return cls.read(cls.component().example)

    def test_it_yields_what_it_says(self) -> None:
        """`yields` is a kind of content, and the example holds that content."""
        reader = self.component()
        kinds = ", ".join(FILE_CONTENTS)
        require(
            reader.yields in FILE_CONTENTS,
            f"yields is {reader.yields!r}",
            f"Set it to one of {kinds}.",
        )
        content = self.part()
        fault = (
            _fault_of_table(content) if reader.yields == "trajectories" else _fault_of_rows(content)
        )
        require(
            not fault,
            f"the example becomes {fault}",
            "Return columns and records as FileReader describes them.",
        )

    def test_places_are_above_the_ground(self) -> None:
        """The states of the example are outside of the Earth."""
        content = self.part()
        if isinstance(content, StateTable):
            least_m = float(np.linalg.norm(content.position_m, axis=1).min())
            require(
                least_m > _INSIDE_M,
                f"the example has a place {least_m * 1e-3:.3f} km from the Earth's centre",
                "Return metres, Earth-fixed: kilometres times 1000, feet times 0.3048.",
            )

    def test_it_recognises_only_its_files(self) -> None:
        """`recognises` is true of the example, with other ends of lines too, and false of other
        texts.
        """
        reader = self.component()
        require(
            reader.recognises(reader.example) is True
            and reader.recognises(f"{reader.example}\n") is True,
            "it does not recognise its example",
            "Return True for every text that begins as files of the format do.",
        )
        taken = [
            name
            for name, text in _STRANGERS.items()
            if reader.recognises(text) and _is_read(self.read, text)
        ]
        require(
            not taken,
            f"it reads {', '.join(taken)}",
            "Recognise a mark of the format, or refuse the text.",
        )

    def test_a_spoilt_file_is_refused_with_the_reason(self) -> None:
        """A file that is cut short, or in which a word is another or two lines have changed places,
        is read, to whole states in order, or raises `BadFileError` with a reason.
        """
        example = self.component().example
        for text in spoilt(example):
            try:
                self.component().recognises(text)
                content = self.read(text)
            except BadFileError as error:
                require(
                    bool(error.args) and len(str(error.args[0])) > 3,
                    f"of the text {text[-40:]!r} it says {error.args!r}",
                    "Say in words what is wrong, with the line, and what to do.",
                )
            except Exception as error:
                require(
                    False,
                    f"the text that ends in {text[-40:]!r} raises {type(error).__name__}: {error}",
                    "Raise BadFileError for every text that the reader cannot take.",
                )
            else:
                fault = _fault_of_table(content) if isinstance(content, StateTable) else ""
                require(
                    not fault,
                    f"the text that ends in {text[-40:]!r} becomes {fault}",
                    "Sort the states, or raise BadFileError with the line.",
                )

    def test_the_content_depends_only_on_the_text(self) -> None:
        """A second call gives the same; clock, network and global random state are not used."""
        require(
            _plain(self.part()) == _plain(self.part()), "a second call gives something else", _ALONE
        )
        require_no_outside_inputs(self.use(), _ALONE)


def spoilt(text: str) -> list[str]:
    """Return the text cut short after each line and in the middle of lines, with each of its words
    replaced, and with its last lines in another order.
    """
    lines = text.splitlines(keepends=True)
    cut = ["".join(lines[:count]) for count in range(len(lines))]
    cut += [
        "".join(lines[:count]) + lines[count][: len(lines[count]) // 2]
        for count in range(len(lines))
    ]
    words = text.split(" ") if " " in text else text.split(",")
    mark = " " if " " in text else ","
    changed = [
        mark.join([*words[:place], "x", *words[place + 1 :]])
        for place in range(min(len(words), 60))
    ]
    changed += [
        mark.join([*words[:place], "1e999", *words[place + 1 :]])
        for place in range(min(len(words), 60))
    ]
    swapped = "".join([*lines[:-2], *reversed(lines[-2:])])
    return [*cut, *changed, swapped, text.replace("\n", ""), text * 2]


def _is_read(read: Any, text: str) -> bool:
    try:
        read(text)
    except BadFileError:
        return False
    return True


def _fault_of_table(table: Any) -> str:
    if not isinstance(table, StateTable):
        return f"{type(table).__name__}, no StateTable"
    count = len(table.time_s)
    shapes: dict[str, tuple[int, ...]] = {"position_m": (count, 3), "run": (count,)}
    if table.velocity_m_s is not None:
        shapes["velocity_m_s"] = (count, 3)
    for name, shape in shapes.items():
        if np.shape(getattr(table, name)) != shape:
            return f"a table with {name} of shape {np.shape(getattr(table, name))}, not {shape}"
    if np.shape(table.burns_s)[1:] != (2,):
        return f"a table with burns_s of shape {np.shape(table.burns_s)}, not (k, 2)"
    if count < 2 or not np.isfinite(table.time_s).all() or not np.isfinite(table.position_m).all():
        return "a table of less than two finite states"
    is_same_run = np.diff(table.run) == 0
    if not (np.diff(table.time_s)[is_same_run] > 0.0).all():
        return "a table whose times do not increase within a run"
    if not (table.burns_s[:, 1] > table.burns_s[:, 0]).all():
        return "a table with a burn that does not end after it begins"
    return "" if isinstance(table.line_of(0), int) else "a table whose line_of returns no number"


def _fault_of_rows(rows: Any) -> str:
    is_list = isinstance(rows, Sequence) and not isinstance(rows, str) and len(rows) > 0
    return (
        "" if is_list and all(isinstance(row, Mapping) for row in rows) else "no list of mappings"
    )


def _plain(content: Any) -> Any:
    if not isinstance(content, StateTable):
        return content
    velocity = None if content.velocity_m_s is None else content.velocity_m_s.tolist()
    return (
        content.time_s.tolist(),
        content.position_m.tolist(),
        velocity,
        content.burns_s.tolist(),
        content.notes,
    )
