"""A step of a command that takes long says so on a terminal, and nowhere else."""

from threading import Event

import pytest

from opir_core.cli import terminal


@pytest.mark.parametrize("is_shown", [True, False])
def test_a_slow_step_is_reported(is_shown, capsys, monkeypatch):
    monkeypatch.setattr(terminal, "_SLOW_S", 0.01)
    with terminal.slow_notice("reading scene.yaml", is_shown=is_shown):
        Event().wait(0.3)
    lines = capsys.readouterr().err.splitlines()
    assert (
        lines[:2]
        == ["opir: reading scene.yaml, 0.01 s so far", "opir: reading scene.yaml, 0.02 s so far"][
            : 2 * is_shown
        ]
    )
    assert len(lines) <= 6


def test_a_quick_step_says_nothing_and_leaves_no_thread(capsys):
    from threading import enumerate as threads

    running = threads()
    with terminal.slow_notice("reading scene.yaml", is_shown=True):
        pass
    assert not capsys.readouterr().err
    assert threads() == running
