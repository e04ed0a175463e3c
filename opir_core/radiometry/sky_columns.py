"""Columns of the shipped LOWTRAN7 tables: the rows of one sky, found without taking the others apart."""

from pathlib import Path


def sky_columns(table: Path, climate: str, aerosol: str) -> dict[str, list[str]]:
    """Return the cells of a climate and aerosol by the name of their column; of a sky that is not there, nothing.

    The rows of one sky stand together, below a line of names.
    """
    text, beginning = table.read_text(encoding="utf-8"), f"\n{climate},{aerosol},"
    first, last = text.find(beginning), text.rfind(beginning)
    if first < 0:
        return {}
    head = text.find("\natmosphere,aerosol,") + 1
    names = text[head : text.find("\n", head)].split(",")
    cells = text[first + 1 : text.find("\n", last + 1)].replace("\n", ",").split(",")
    return {name: cells[place :: len(names)] for place, name in enumerate(names)}
