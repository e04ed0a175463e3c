"""The problems of a scene that show when its components are built: collected, so that all are reported at once."""

from collections.abc import Iterator
from contextlib import contextmanager

from attrs import define, evolve, field

from opir_core.errors import Problem, SceneError


@define
class BuildProblems:
    """The problems of several components, each once, with their paths in the scene."""

    found: dict[Problem, None] = field(factory=dict)

    @contextmanager
    def of(self, path: str) -> Iterator[None]:
        """Collect the problems of the component at a path; it may name its settings relative to its own block."""
        try:
            yield
        except SceneError as error:
            self.found |= dict.fromkeys(_under(path, problem) for problem in error.problems)

    def require_none(self) -> None:
        """Raise `SceneError` with all problems, if any."""
        if self.found:
            raise SceneError(self.found)


def _under(path: str, problem: Problem) -> Problem:
    if problem.path.startswith(path):
        return problem
    return evolve(problem, path=f"{path}.{problem.path}" if problem.path else path)
