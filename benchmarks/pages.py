"""Runs a benchmark and writes its page: options, data as CSV, plot as SVG, text as Markdown."""

import argparse
import csv
import io
import statistics
import sys
import time
from collections.abc import Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from math import isnan
from pathlib import Path
from typing import Any

#: Colours that colour-blind readers can distinguish (Okabe and Ito, 2008).
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#D55E00", "#CC79A7", "#56B4E9", "#666666")
GREY = COLOURS[-1]

#: How lines of peers begin, and the module that each needs.
PEERS = {"Stone Soup": "stonesoup", "FilterPy": "filterpy"}

Row = Mapping[str, Any]


class Table(list[dict[str, Any]]):
    """Rows of a CSV file, numbers as numbers, and the facts about the run above them."""

    facts: dict[str, Any]

    def where(self, **cells):
        """Return the rows with these cells."""
        return Table(row for row in self if cells.items() <= row.items())

    def row(self, **cells):
        """Return the first row with these cells."""
        return self.where(**cells)[0]

    def column(self, name):
        """Return the values of a column, nan for empty cells."""
        return [float("nan") if row[name] == "" else row[name] for row in self]

    def names(self, column):
        """Return the different values of a column, in order of appearance."""
        return list(dict.fromkeys(row[column] for row in self))


def options_of(description, **defaults):
    """Return the options of the command line: one for each default, `--write` and `--from-csv`.

    A default of `False` makes a flag, a type an option without a default, a tuple an option with
    several values, which are choices if they are strings.
    """
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    for name, default in defaults.items():
        settings = {"type": type(default), "default": default}
        if isinstance(default, bool):
            settings = {"action": "store_true"}
        elif callable(default):
            settings = {"type": default}
        elif isinstance(default, tuple):
            settings |= {"type": type(default[0]), "nargs": "+"}
            settings |= {"choices": default} if isinstance(default[0], str) else {}
        parser.add_argument("--" + name.replace("_", "-"), **settings)
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="for page, plot and data")
    parser.add_argument("--from-csv", type=Path, metavar="FOLDER", help="draw again from its data")
    return parser.parse_args()


def publish(
    options,
    page,
    draw=None,
    facts=None,
    **tables,
):
    """Print the rows of tables; write them, the page and the plot into the folder of the options.

    The first table names page and plot; `page` takes all tables, `draw` the path of the plot and
    the first table. With `--from-csv` nothing is measured. `facts` may be filled meanwhile.
    """
    folder = options.from_csv or options.write
    name = next(iter(tables))
    if options.from_csv is None:
        for title, rows in tables.items():
            table = [printed(row) for row in rows]
            if folder:
                write_csv(folder / f"{title}.csv", table, facts if title == name else None)
    if folder:
        stored = [read_csv(folder / f"{title}.csv") for title in tables]
        (folder / f"{name}.md").write_text(page(*stored), encoding="utf-8")
        if draw:
            draw(folder / f"{name}.svg", stored[0])


def printed(row):
    """Print a row and return it."""
    print(",".join(map(cell_text, row.values())), flush=True)
    return row


def cell_text(value):
    """Return a value as a CSV file has it: six digits, nothing for nan."""
    if isinstance(value, float):
        return "" if isnan(value) else f"{value:.6g}"
    return str(value)


def write_csv(path, rows, facts=None):
    """Write rows with the same columns, if there are any, and facts about the run above them as
    `# name: value`.
    """
    text = io.StringIO()
    text.writelines(f"# {name}: {cell_text(value)}\n" for name, value in (facts or {}).items())
    writer = csv.writer(text, lineterminator="\n")
    if rows:
        writer.writerow(rows[0])
    writer.writerows([cell_text(value) for value in row.values()] for row in rows)
    path.write_text(text.getvalue(), encoding="utf-8")


def read_csv(path):
    """Return the rows of a CSV file."""
    lines = path.read_text(encoding="utf-8").splitlines()
    facts = [line.removeprefix("# ").split(": ", 1) for line in lines if line.startswith("# ")]
    rows = csv.DictReader(line for line in lines if not line.startswith("# "))
    table = Table({name: value_of(cell) for name, cell in row.items()} for row in rows)
    table.facts = {name: value_of(cell) for name, cell in facts}
    return table


def value_of(cell):
    """Return the number that a cell holds, or its text."""
    for kind in (int, float):
        try:
            return kind(cell)
        except ValueError:
            continue
    return cell


def markdown_table(head, rows):
    """Return a Markdown table."""
    lines = (f"| {' | '.join(map(str, cells))} |" for cells in (head, *rows))
    return "\n".join([next(lines), "|" + "---|" * len(head), *lines])


def shown(value, form):
    """Return a number in a format, a dash for an empty cell or nan."""
    return "–" if value == "" or isnan(value) else format(value, form)


def interval_text(row, name, form, unit=""):
    """Return a figure with its 95 % interval, columns `<name>_low95` and `<name>_high95`."""
    low = row[f"{name}_low95"]
    if row[name] == "" or low == "":
        return shown(row[name], form)
    return f"{row[name]:{form}}{unit} [{low:{form}}, {row[f'{name}_high95']:{form}}]"


@contextmanager
def svg_plot(path, *shape, **settings):
    """Yield a figure and its axes, as `matplotlib.pyplot.subplots`; save it reproducibly as SVG."""
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(*shape, layout="constrained", **settings)
    yield figure, axes
    for panel in figure.axes:
        panel.grid(alpha=0.3)
    if not figure.legends:
        add_legends(figure)
    figure.savefig(path, metadata={"Date": None})
    pyplot.close(figure)


def add_legends(figure):
    """Add a legend to each panel with labels; one below several panels, if all have the same."""
    labelled = [panel for panel in figure.axes if panel.get_legend_handles_labels()[1]]
    if len(figure.axes) > 1 and len({labels_of(panel) for panel in labelled}) == 1:
        handles, labels = labelled[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=7)
        return
    for panel in labelled:
        panel.legend(fontsize=7)


def labels_of(panel):
    """Return the labels of a panel."""
    return tuple(panel.get_legend_handles_labels()[1])


def draw_lines(axes, rows, by, across, up, style="o-"):
    """Draw a line of one column against another for each value of a third."""
    for name in rows.names(by):
        line = rows.where(**{by: name})
        axes.plot(line.column(across), line.column(up), style, markersize=4, label=name)


def median_s(action, repeat, warm=True):
    """Return the median processor time of an action, after one call that is not counted."""
    return turns_s({"": action}, repeat, warm)[""]


def turns_s(actions, repeat, warm=True):
    """Return median processor times of actions, done in turn: a slow spell meets all alike."""
    times = {name: [] for name in actions}
    for _ in range(repeat + warm):
        for name, action in actions.items():
            start = time.process_time()
            action()
            times[name].append(time.process_time() - start)
    return {name: statistics.median(taken[warm:]) for name, taken in times.items()}


def is_installed(name):
    """Whether a line of a table can be measured: a peer's only if its module is installed."""
    return all(find_spec(module) for peer, module in PEERS.items() if name.startswith(peer))


def installed(names):
    """Return the names without those of missing peers, which are named on standard error."""
    lines = list(names)
    for peer in absent(filter(is_installed, lines)):
        if any(name.startswith(peer) for name in lines):
            print(
                f"{peer}: left out, not installed (the extra `benchmarks` brings it)",
                file=sys.stderr,
            )
    return list(filter(is_installed, lines))


def absent(names):
    """Return the peers without a line among these."""
    lines = list(names)
    return [peer for peer in PEERS if not any(name.startswith(peer) for name in lines)]


def left_out(names):
    """Return a sentence for a page about peers without a line, empty if all have one."""
    missing = absent(names)
    return f"\nLeft out, because not installed: {' and '.join(missing)}.\n" if missing else ""
