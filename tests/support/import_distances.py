"""How many imports lie between a module and the files that use it."""

import ast
from functools import cache
from pathlib import Path


def source_files(root):
    """Return the modules of opir_core and the plugins, sorted, relative to the root."""
    result = [*(root / "opir_core").rglob("*.py"), *(root / "plugins").glob("*/opir_*/**/*.py")]
    return sorted(str(path.relative_to(root)) for path in result)


def imports_of(root, files):
    """Return, for every file, those of the files that it imports or names in a string, as entry
    points do.
    """
    modules = {module_of(file): file for file in files}
    return {file: _named(root, file, module, modules) - {file} for module, file in modules.items()}


def distances(file, imports):
    """Return, for every file that uses a file, the number of imports between them (1: directly)."""
    result = dict[str, int]()
    front = {file}
    while front:
        front = (
            {user for user, imported in imports.items() if imported & front}
            - result.keys()
            - {file}
        )
        result |= dict.fromkeys(front, 1 + max(result.values(), default=0))
    return result


def module_of(file):
    """Return the name under which others import a file: a plugin's and a test's lie below folders
    on the path.
    """
    words = Path(file).with_suffix("").parts
    inner = words[2:] if words[0] in ("plugins", "tests") else words
    return ".".join(inner[:-1] if inner[-1] == "__init__" else inner)


def _named(root, file, module, modules):
    names = set[str]()
    path = root / file
    package = module if path.stem == "__init__" else module.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            homes = _homes((root / modules.get(node.module or "", "")).with_suffix(".pyi"))
            names |= {homes.get(name.name, f"{node.module}.{name.name}") for name in node.names} | {
                node.module or ""
            }
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            names |= {
                node.value,
                f"{node.value}.plugin",
                f"{package}.{node.value}",
                f"opir_core.{node.value}",
            }
    return {modules[name] for name in names if name in modules}


@cache
def _homes(stub):
    """Return the modules of the names that the stub of a package hands on; none where there is no
    stub.
    """
    nodes = ast.parse(stub.read_text(encoding="utf-8")).body if stub.is_file() else []
    return {
        name.name: str(node.module)
        for node in nodes
        if isinstance(node, ast.ImportFrom)
        for name in node.names
    }
