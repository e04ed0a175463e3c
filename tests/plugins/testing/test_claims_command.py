"""`opir claims`: which claims it prints, and how many of all are validated."""

import json

import pytest
from command_line import run_command


def test_words_and_status_select_claims(capsys):
    run_command("claims glider --status validated --json")
    rows = json.loads(capsys.readouterr().out)
    assert rows
    assert all(row["status"] == "VALIDATED" for row in rows)
    assert all("glider" in " ".join(row.values()).lower() for row in rows)


def test_the_list_ends_with_the_count_of_all(capsys):
    run_command("claims burn times")
    text = capsys.readouterr().out
    assert "250 s liquid, 170 s solid" in " ".join(text.split())
    *_, count = text.split("\n\n")
    assert count.startswith(
        "110 claims: 87 VALIDATED (34 by published figures, 21 by another library"
    )


def test_lines_fit_a_terminal_of_100_columns(capsys):
    run_command("claims")
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 100
    order = ("VALIDATED", "MODELLED", "NOTIONAL")
    places = [order.index(line.split()[0]) for line in lines[:-2] if line[:1].isupper()]
    assert places == sorted(places)
    assert len(places) == 110


@pytest.mark.parametrize("words", ["nothing-of-the-kind", "glider nothing-of-the-kind"])
def test_words_of_no_claim_are_reported(words, capsys):
    run_command(f"claims {words}", code=1)
    assert "no claim has all of these words" in capsys.readouterr().out
