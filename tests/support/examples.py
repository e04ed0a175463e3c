"""Numbers of hypothesis examples."""

from math import ceil

from hypothesis import settings


def examples(count):
    """Return settings with `count` examples in the profile `full`, and with the same share fewer in
    other profiles.
    """
    return settings(max_examples=ceil(count * settings().max_examples / 100))
