"""The verdict of a contract's test: what a component does, and what to change."""


class Broken(AssertionError):  # noqa: N818 - a verdict, as pytest.Failed
    """A promise that a component does not keep; `seen` says what was seen, `change` what to change."""

    def __init__(self, seen: str, change: str) -> None:
        self.seen = seen
        self.change = change
        super().__init__(f"{seen}\n{change}")


def insist(kept: object, seen: str, change: str) -> None:
    """Raise `Broken` unless a promise is kept."""
    if not kept:
        raise Broken(seen, change)
