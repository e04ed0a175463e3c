"""Commands of pages, in blocks of any kind: the parser takes them, and their files and folders are
there.
"""

import re
import shlex
import subprocess
from pathlib import PurePosixPath
from typing import NamedTuple

import pytest
from repository import ROOT

from opir_core.cli.main import full_parser

PAGES = sorted(
    [ROOT / "README.md", *(ROOT / "docs").rglob("*.md"), *(ROOT / "plugins").glob("*/README.md")]
)
FENCE = re.compile(
    r"^(?P<indent> *)```(?P<kind>\w*)\n(?P<body>.*?)^(?P=indent)```$", re.MULTILINE | re.DOTALL
)
KINDS = {"", "sh", "bash", "shell", "console"}
SEPARATORS = {"&&", "||", ";", "|", "&"}

ELLIPSES = {"…", "..."}

#: The options of commands that write a file or a folder beside it.
OUTPUTS = {"--out", "-o", "--truth", "--report", "--figures", "--html", "--tracks", "--write"}

#: Folders of a clone that commands of pages read.
OWN = {("examples",), ("docs",), ("plugins",), ("benchmarks",), ("tests",)}


class Command(NamedTuple):
    """The words of one command of a page."""

    line: str
    words: list[str]


def commands(text):
    """Yield the commands of a page in order: lines of blocks, without prompts, comments and what
    they print.
    """
    for match in FENCE.finditer(text):
        if match["kind"] not in KINDS:
            continue
        body = match["body"].replace("\\\n", " ")
        prompted = [line[2:] for line in body.splitlines() if line.startswith("$ ")]
        for line in prompted or body.splitlines():
            yield from _parts(line.strip())


def _parts(line):
    try:
        lexer = shlex.shlex(line, posix=True, punctuation_chars=True)
        lexer.wordchars += "@%{}[],:!+"
        tokens = list(lexer)
    except ValueError:
        return
    words = []
    for token in [*tokens, ";"]:
        if token in SEPARATORS:
            if words:
                yield Command(line, words)
            words = []
        else:
            words.append(token)


def opir_words(command):
    """Return the arguments of an `opir` command, without redirections; None for any other."""
    words = command.words
    while words and re.fullmatch(r"[A-Z_]+=\S*", words[0]):
        words = words[1:]
    if len(words) < 2 or words[0] != "opir" or words[1] in ELLIPSES:
        return None
    redirected = next(
        (number for number, word in enumerate(words) if word in {">", ">>", "<", ">&"}), len(words)
    )
    has_descriptor = redirected < len(words) and words[redirected - 1] in {"1", "2"}
    return words[1 : redirected - has_descriptor]


@pytest.fixture(scope="module")
def parser():
    return full_parser()


def is_refused(arguments, parser):
    """Return whether the parser refuses arguments; those with an ellipsis are not meant to be
    typed.
    """
    if ELLIPSES & set(arguments):
        return False
    try:
        parser.parse_args(arguments)
    except SystemExit as refused:
        return bool(refused.code)
    return False


def missing_paths(arguments, written):
    """Yield the folders that outputs need and the paths of a clone that are not there; outputs
    count as made then.
    """
    for option, word in zip(["", *arguments], arguments, strict=False):
        path = PurePosixPath(word)
        if option in OUTPUTS:
            folder = path.parent
            if not (
                folder == PurePosixPath()
                or folder.is_absolute()
                or folder in written
                or (ROOT / folder).is_dir()
            ):
                yield f"nothing has made the folder {folder}"
            written.add(path)
        elif (
            path.parts[:1] in OWN
            and "*" not in word
            and path not in written
            and not (ROOT / path).exists()
        ):
            yield f"{path} is not there"


def problems(text, parser):
    """Yield what is wrong with the commands of a page that is followed from a clone."""
    written = set()
    for command in commands(text):
        if command.words[0] == "mkdir":
            written.update(PurePosixPath(word) for word in command.words[1:])
        arguments = opir_words(command)
        if arguments is None:
            continue
        if is_refused(arguments, parser):
            yield f"{command.line}: the parser refuses it"
        yield from (f"{command.line}: {problem}" for problem in missing_paths(arguments, written))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_documented_commands_are_taken_from_a_clone(page, parser):
    assert not list(problems(page.read_text(encoding="utf-8"), parser))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "```sh\nopir run examples/pacific_test_range.yaml --out run/events.jsonl\n```\n",
            "made the folder run",
        ),
        ("```\nopir run examples/none.yaml\n```\n", "none.yaml is not there"),
        ("```console\n$ opir run --no-such-option\n```\n", "the parser refuses it"),
    ],
)
def test_what_fails_in_a_fresh_clone_is_found(text, words, parser):
    assert any(words in problem for problem in problems(text, parser))


#: Commands that read a scene at most and take a second or two.
QUICK = {"check", "explain", "physics"}


def quick_commands():
    """Return the quick commands of blocks that are not executed as `console` blocks are, with files
    of a clone only.
    """
    lines = [command for page in PAGES for command in commands(page.read_text(encoding="utf-8"))]
    quick = [
        shlex.join(command.words)
        for command in lines
        if (words := opir_words(command)) and words[0] in QUICK
    ]
    return sorted({line for line in quick if not re.search(r"[A-Z]{4,}|[<>…]|my-", line)})


@pytest.mark.slow
@pytest.mark.parametrize("line", quick_commands())
def test_quick_documented_commands_run_in_an_empty_folder(line, tmp_path):
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    done = subprocess.run(
        line, shell=True, cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
