"""Contents of files spoilt by a seed: their bytes, words, lines, values and columns."""

import copy
import gzip
import io
import json
import zipfile
from collections.abc import Callable, Iterator
from random import Random
from typing import Any

import yaml
from repository import DATA

#: Replacements of a word, and marks that part words.
WORDS = (DATA / "spoilt_words.txt").read_text(encoding="utf-8").split("\n")
MARKS = ' ,;\t\n=<>":'

#: Replacements of a value of JSON or YAML.
VALUES: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 0.5, -0.0, 1e-320, 1e308, -1e308, 2**31, 2**53 + 1, 2**63, 10**29,
    10**400, float("nan"), float("inf"), -float("inf"), "", " ", "x", "nan", "1e999", "NO", "50",
    "\u0000", "\ud800", "\u202e", "x" * 5000, "../../etc", "/dev/null", "2026-13-45T99:99:99Z",
    "9999-12-31T23:59:59Z", "0001-01-01T00:00:00Z", [], {}, [[]], [{}], [None], {"": {}}, {"a": 1},
    [0.0] * 3, [1e308] * 3, list(range(1000)), [[0, 0]] * 100,
)  # fmt: skip

#: Text of YAML that says a value by a name, a tag or another document.
YAML_TEXTS = (
    "a: &a [x, x]\nb: &b [*a, *a, *a]\nc: &c [*b, *b, *b]\n",
    "<<: {a: 1}\n",
    "? [a, b]\n: 1\n",
    "!!python/object/apply:os.system [ls]\n",
    "--- \n",
    "%YAML 9.9\n---\n",
    "a: |\n  b\n c\n",
    "\tscene: x\n",
)

Deed = Callable[[bytes, Random], bytes]


def place_in(content: bytes, rng: Random) -> int:
    return rng.randrange(len(content) + 1)


def cut(content: bytes, rng: Random) -> bytes:
    return content[: place_in(content, rng)]


def gap(content: bytes, rng: Random) -> bytes:
    start = place_in(content, rng)
    return content[:start] + content[start + rng.choice((1, 8, 500)) :]


def doubled(content: bytes, rng: Random) -> bytes:
    start = place_in(content, rng)
    end = start + rng.choice((1, 30, 3000))
    return content[:end] + content[start:end] * rng.choice((1, 1, 50)) + content[end:]


def noise(content: bytes, rng: Random) -> bytes:
    start = place_in(content, rng)
    added = rng.randbytes(rng.choice((1, 4, 300)))
    return content[:start] + added + content[start + rng.choice((0, len(added))) :]


def flipped(content: bytes, rng: Random) -> bytes:
    changed = bytearray(content)
    for _ in range(rng.choice((1, 3)) if content else 0):
        changed[rng.randrange(len(changed))] ^= 1 << rng.randrange(8)
    return bytes(changed)


def marked(content: bytes, rng: Random) -> bytes:
    mark = rng.choice((b"\xef\xbb\xbf", b"\xff\xfe", b"\0", b"\n\n", b"#", b"PAR1", b"PK\3\4"))
    return rng.choice((mark + content, content + mark))


def recoded(content: bytes, rng: Random) -> bytes:
    text = content.decode("utf-8", "replace")
    return text.encode(rng.choice(("utf-16", "utf-16-le", "utf-32", "cp1252")), "replace")


def ends_of_lines(content: bytes, rng: Random) -> bytes:
    return content.replace(
        b"\n", rng.choice((b"\r\n", b"\r", b"\n\n", b" ", b"\x0b", b"\xe2\x80\xa8"))
    )


def packed(content: bytes, rng: Random) -> bytes:
    whole = gzip.compress(content, mtime=0)
    return rng.choice((whole, whole[:-9], whole * 2, b"\x1f\x8b" + rng.randbytes(40)))


def archived(content: bytes, rng: Random) -> bytes:
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr(rng.choice(("../a", "/etc/a", "a\x00b", " ", "é", "a/")), content)
    return archive.getvalue()


def blank(_content: bytes, rng: Random) -> bytes:
    return rng.choice(
        (b"", b"\n", b" \t", b"\0" * 100, b"{}", b"[]", b"null", b"0", b'""', b"{}\n{}\n")
    )


BYTE_DEEDS: tuple[Deed, ...] = (
    cut, gap, doubled, noise, flipped, marked, recoded, ends_of_lines, packed, archived, blank
)  # fmt: skip


def of_text(change: Callable[[str, Random], str]) -> Deed:
    """Return a deed on bytes by one on their text."""

    def deed(content: bytes, rng: Random) -> bytes:
        return change(content.decode("utf-8", "surrogateescape"), rng).encode(
            "utf-8", "surrogateescape"
        )

    return deed


@of_text
def word(text: str, rng: Random) -> str:
    mark = rng.choice(MARKS)
    words = text.split(mark)
    words[rng.randrange(len(words))] = rng.choice(WORDS)
    return mark.join(words)


@of_text
def lines(text: str, rng: Random) -> str:
    rows = text.split("\n")
    first, second = rng.randrange(len(rows)), rng.randrange(len(rows))
    kind = rng.randrange(4)
    if kind == 0:
        rows[first], rows[second] = rows[second], rows[first]
    elif kind == 1:
        rows.insert(first, rows[second])
    elif kind == 2:
        del rows[first]
    else:
        rows[first:first] = [rows[second]] * 200
    return "\n".join(rows)


@of_text
def cells(text: str, rng: Random) -> str:
    """Change one column of a table in all lines below some line."""
    mark = rng.choice(",;\t ")
    rows = [row.split(mark) for row in text.split("\n")]
    start = rng.randrange(len(rows))
    column = rng.randrange(max(map(len, rows)))
    value = rng.choice([*WORDS, None, None])
    for row in rows[start:]:
        if column < len(row):
            row[column : column + 1] = [] if value is None else [value]
    return "\n".join(map(mark.join, rows))


TEXT_DEEDS: tuple[Deed, ...] = (word, word, word, lines, lines, cells)


def branches(value: Any) -> Iterator[Any]:
    """Yield every list and mapping of a value that has items."""
    if isinstance(value, list | dict):
        if value:
            yield value
        for inner in value.values() if isinstance(value, dict) else value:
            yield from branches(inner)


def changed_value(value: Any, rng: Random) -> Any:
    """Return a value of JSON with one item dropped, replaced, renamed, doubled, wrapped or nested."""
    places = list(branches(value))
    if not places:
        return rng.choice(VALUES)
    # Deep places are many: each depth of a few has its share.
    place = places[rng.randrange(rng.choice((1, len(places))))]
    key = rng.choice(list(place) if isinstance(place, dict) else range(len(place)))
    kind = rng.randrange(9)
    if kind < 4:
        place[key] = copy.deepcopy(rng.choice(VALUES))
    elif kind == 4:
        del place[key]
    elif kind == 5:
        other = rng.choice(places)
        place[key] = copy.deepcopy(
            rng.choice(list(other.values() if isinstance(other, dict) else other))
        )
    elif kind == 6:
        for _ in range(rng.choice((1, 1, 60, 3000))):
            place[key] = [place[key]] if rng.random() < 0.5 else {"a": place[key]}
    elif isinstance(place, list):
        place[key:key] = [place[key]] * rng.choice((1, 50))
    else:
        place[
            rng.choice((f"{key}x", f"{key}"[:-1], f"{key}".upper(), "", "model", "a.b", "\0"))
        ] = place.pop(key) if kind == 7 else copy.deepcopy(place[key])
    return value


def json_text(value: Any, rng: Random) -> str:
    """Return JSON of a value, at times with a key twice; nesting may be deeper than Python writes."""
    try:
        text = json.dumps(value)
    except RecursionError:
        return "[" * 100_000
    if rng.random() < 0.1 and text.startswith("{"):
        return text[:-1] + "," + text[1:]
    return text


def json_value(content: bytes, rng: Random) -> bytes:
    return json_text(changed_value(json.loads(content), rng), rng).encode()


def json_line(content: bytes, rng: Random) -> bytes:
    """Change one line of JSON lines, or the same in all."""
    rows = content.decode().splitlines()
    first = rng.randrange(len(rows))
    selected = rng.choice(([first], [first], range(len(rows))))
    state = rng.getstate()
    for row in selected:
        rng.setstate(state)
        rows[row] = json_text(changed_value(json.loads(rows[row]), rng), rng)
    return ("\n".join(rows) + "\n").encode()


def yaml_value(content: bytes, rng: Random) -> bytes:
    """Change a value of YAML, which takes JSON; or put text of YAML before or after."""
    if rng.random() < 0.15:
        added = rng.choice(YAML_TEXTS).encode()
        return rng.choice((added + content, content + added))
    return json_text(changed_value(yaml.safe_load(content), rng), rng).encode()


def parquet_table(content: bytes, rng: Random) -> bytes:
    """Change the columns of a Parquet file: their types, names, values, nesting and row groups."""
    import pyarrow
    from pyarrow import parquet

    table = parquet.read_table(io.BytesIO(content))
    place = rng.randrange(table.num_columns)
    name = table.column_names[place]
    column = table.column(place)
    kind = rng.randrange(9)
    if kind == 0:
        table = table.remove_column(place)
    elif kind == 1:
        table = table.append_column(rng.choice(("", name, "x" * 300, "time_s")), column)
    elif kind == 2:
        table = table.rename_columns(
            [*table.column_names[:place], f"{name}x", *table.column_names[place + 1 :]]
        )
    elif kind == 3:
        table = table.slice(0, rng.choice((0, 1)))
    elif kind == 4:
        rows = [rng.randrange(table.num_rows) for _ in range(table.num_rows + rng.choice((0, 50)))]
        table = table.take(rows) if table.num_rows else table
    elif kind == 5 and table.num_rows:
        table = table.set_column(place, name, pyarrow.nulls(table.num_rows, column.type))
    elif table.num_rows:
        table = table.set_column(place, name, other_column(column, rng))
    written = io.BytesIO()
    try:
        parquet.write_table(table, written, row_group_size=rng.choice((1, 5, 10_000)))
    except (pyarrow.ArrowException, ValueError):
        return content[: len(content) // 2]
    return written.getvalue()


def other_column(column: Any, rng: Random) -> Any:
    """Return a column of another type, or of numbers that are none."""
    import pyarrow

    values = column.to_pylist()
    makers: tuple[Callable[[], Any], ...] = (
        lambda: pyarrow.array([rng.choice(WORDS) for _ in values], pyarrow.string()),
        lambda: pyarrow.array(
            [rng.choice((0.0, float("nan"), float("inf"), 1e308, -1e308)) for _ in values]
        ),
        lambda: pyarrow.array([rng.choice((0, 2**63 - 1, -(2**63))) for _ in values]),
        lambda: pyarrow.array([str(value) for value in values]).dictionary_encode(),
        lambda: pyarrow.array([[value] for value in values]),
        lambda: pyarrow.array([{"a": value} for value in values]),
        lambda: pyarrow.array([str(value).encode() for value in values], pyarrow.binary()),
        lambda: pyarrow.array(range(len(values)), pyarrow.timestamp("ns")),
        lambda: pyarrow.array([rng.choice((value, None)) for value in values], column.type),
        lambda: pyarrow.array([bool(value) for value in values]),
        lambda: pyarrow.nulls(len(values)),
    )
    return rng.choice(makers)()


#: Deeds on the structure of a form.
DEEDS: dict[str, tuple[Deed, ...]] = {
    "text": TEXT_DEEDS,
    "json": (json_value, json_value, word),
    "jsonl": (json_line, json_line, json_line, lines, word),
    "yaml": (yaml_value, yaml_value, yaml_value, word, lines),
    "parquet": (parquet_table,),
    "bytes": (flipped, noise, cut),
}


def form_of(name: str) -> str:
    """Return the form of a file by the end of its name."""
    ending = name.rpartition(".")[2]
    return ending if ending in DEEDS else "text"


def spoilt(content: bytes, form: str, rng: Random) -> bytes:
    """Return a content with one deed done to its structure or bytes, or two."""
    for _ in range(rng.choice((1, 1, 2))):
        deed = rng.choice(BYTE_DEEDS if rng.random() < 0.25 else DEEDS[form])
        try:
            content = deed(content, rng)
        except (ValueError, LookupError, TypeError, yaml.YAMLError, RecursionError, OSError):
            content = rng.choice(BYTE_DEEDS)(content, rng)
    return content
