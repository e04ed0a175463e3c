"""`opir claims`: which claims it prints, and how many of all are validated."""

import json

import pytest
from command_line import run_command


def test_words_and_status_select_claims(capsys):
    run_command("claims glider --status VALIDATED --json")
    rows = json.loads(capsys.readouterr().out)
    assert rows
    assert all(row["status"] == "VALIDATED" for row in rows)
    assert all("glider" in " ".join(row.values()).lower() for row in rows)


def test_the_table_ends_with_the_count_of_all(capsys):
    run_command("claims burn times")
    text = capsys.readouterr().out
    assert "250 s liquid, 170 s solid" in text
    assert text.splitlines()[-1].startswith("110 claims: 83 VALIDATED, ")


@pytest.mark.parametrize("words", ["nothing-of-the-kind", "glider nothing-of-the-kind"])
def test_words_of_no_claim_are_reported(words, capsys):
    run_command(f"claims {words}", code=1)
    assert "no claim has all of these words" in capsys.readouterr().out
