"""Texts of SVG figures with the boxes that they take, measured in the font that matplotlib names."""

import re
from functools import cache
from itertools import combinations
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from matplotlib.font_manager import FontProperties
from matplotlib.textpath import TextPath

_SVG = re.compile(r"<svg.*?</svg>", re.DOTALL)
_VIEW = re.compile(r'viewBox="0 0 ([\d.]+) ([\d.]+)"')
_ROTATION = re.compile(r"rotate\((-?[\d.]+)")
_MOVE = re.compile(r"translate\((-?[\d.]+) (-?[\d.]+)\)")
_SIZE = re.compile(r"font: ?(?:\w+ )*([\d.]+)px|font-size: ?([\d.]+)px")
_ANCHOR = re.compile(r"text-anchor: ?(\w+)")
_LEFT = {"start": 0.0, "middle": 0.5, "end": 1.0}


class SvgText(NamedTuple):
    """A text and the corners (4, 2) of its box, in the units of its figure."""

    words: str
    corners: np.ndarray


def figures_in(page):
    """Return the SVG elements of a page."""
    return _SVG.findall(page)


@cache
def _extent(words, size):
    """Return left, bottom, right and top of the ink of a text that stands at the origin."""
    box = TextPath(
        (0, 0), words, size=size, prop=FontProperties(family="DejaVu Sans")
    ).get_extents()
    return box.x0, box.y0, box.x1, box.y1


def texts_of(svg):
    """Return the texts of a figure with the boxes of their ink."""
    root = ElementTree.fromstring(svg.replace("xlink:href", "href"))
    texts = []
    for element in root.iter():
        words = "".join(element.itertext()).strip()
        style = element.get("style", "")
        sized = _SIZE.search(style)
        # Powers of ten are of several pieces with sizes of their own, and are left out.
        if not element.tag.endswith("text") or not words or sized is None:
            continue
        size = next(float(number) for number in sized.groups() if number)
        left, bottom, right, top = _extent(words, size)
        anchor = _ANCHOR.search(style)
        shift = _LEFT[anchor[1] if anchor else "start"] * right
        box = np.array([[left, -bottom], [right, -bottom], [right, -top], [left, -top]])
        box[:, 0] -= shift
        transform = element.get("transform", "")
        turned = _ROTATION.search(transform)
        angle = np.radians(float(turned[1]) if turned else 0.0)
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        moved = _MOVE.search(transform)
        place = [
            float(each)
            for each in (
                moved.groups() if moved else (element.get("x", "0"), element.get("y", "0"))
            )
        ]
        texts.append(SvgText(words, box @ turn + place))
    return texts


def overprints(svg, least=0.5):
    """Return the pairs of texts whose boxes lie on each other by more than `least` in every
    direction.
    """
    return [
        (first.words, second.words)
        for first, second in combinations(texts_of(svg), 2)
        if _overlap(first.corners, second.corners) > least
    ]


def cut_texts(svg, slack=1.5):
    """Return the texts that reach out of the figure."""
    width, height = (float(size) for size in _VIEW.search(svg).groups())
    return [
        text.words
        for text in texts_of(svg)
        if np.any(text.corners < -slack) or np.any(text.corners > np.array([width, height]) + slack)
    ]


def _overlap(first, second):
    """Return the least length that separates two boxes (4, 2), by the separating axis theorem."""
    edges = np.concatenate([np.diff(first[:3], axis=0), np.diff(second[:3], axis=0)])
    lengths = []
    for edge in edges:
        normal = np.array([-edge[1], edge[0]]) / max(float(np.hypot(*edge)), 1e-9)
        one, other = first @ normal, second @ normal
        lengths.append(min(one.max(), other.max()) - max(one.min(), other.min()))
    return min(lengths)
