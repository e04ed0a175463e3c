"""The page of what is modelled: every default of every component has a source or the word notional."""

from pathlib import Path

from opir_core.plugin.components import CATALOGUE, Component
from opir_core.plugin.description import field_rows
from opir_core.plugin.host import Host

PAGE = Path(__file__).parents[2] / "docs" / "explanation" / "what-is-modelled.md"


def test_every_default_of_the_core_says_where_it_comes_from():
    page = PAGE.read_text(encoding="utf-8")
    host, told = Host.of(), 0
    for hook in CATALOGUE:
        for name in host.names(hook):
            component = host.component(hook, name)
            assert isinstance(component, Component)
            for row in field_rows(component.config):
                if row.is_required or row.default is None or "." in row.key:
                    continue
                line = next(
                    one for one in page.splitlines() if one.startswith(f"| {component.kind} `{name}` | `{row.key}` |")
                )
                assert line.removesuffix(" |").rpartition(" | ")[2], line
                told += 1
    assert told > 50


def test_every_part_of_the_chain_says_how_it_is_had():
    chain = PAGE.read_text(encoding="utf-8").split("## The chain")[1].split("## Every default")[0]
    rows = [line.split(" | ") for line in chain.splitlines() if line.startswith("| ") and not line.startswith("| part")]
    assert len(rows) > 10
    assert {row[1] for row in rows} == {"computed", "tabulated", "notional"}
    assert all(len(row) == 4 and all(row) for row in rows)
