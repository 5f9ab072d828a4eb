"""What the source of the tests shows without running it: phrases, imports that tests do not make, claims."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

PHRASE = re.compile(r"[A-Za-z]{2,}[,;:]? [a-z]{2,}")
"""Two words of a sentence; names of files, keys, effects and columns have no blanks."""
JUDGES = {"startswith", "endswith", "search", "match", "fullmatch", "findall", "count", "index"}
"""Functions that an assertion gives a text to look for."""
PUBLIC = {"_core", "_repr_html_", "_replace", "_asdict", "_fields", "_exit", "_page_box"}
"""Not private for all their underline: the compiled core, hooks of notebooks and named tuples, WeasyPrint's pages."""
CLOCKS = {"monotonic", "perf_counter", "process_time", "thread_time", "monotonic_ns", "perf_counter_ns", "getrusage"}


def phrases(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and text of every phrase of English on which an assertion of the test hangs."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assert):
            yield from _looked_for(node.test)
        elif isinstance(node, ast.keyword) and node.arg == "match":
            yield from _texts(node.value)


def _looked_for(node: ast.AST) -> Iterator[tuple[int, str]]:
    """Texts that are compared with, or looked for; not those by which something is called or found."""
    if isinstance(node, ast.Subscript):
        yield from _looked_for(node.value)
    elif isinstance(node, ast.Call):
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        yield from _looked_for(node.func)
        for argument in [*node.args, *(k.value for k in node.keywords)] if name in JUDGES else []:
            yield from _looked_for(argument)
    elif isinstance(node, ast.Constant | ast.JoinedStr):
        yield from _texts(node)
    else:
        for child in ast.iter_child_nodes(node):
            yield from _looked_for(child)


def _texts(node: ast.AST) -> Iterator[tuple[int, str]]:
    for part in ast.walk(node):
        if isinstance(part, ast.Constant) and isinstance(part.value, str) and PHRASE.search(_plain(part.value)):
            yield part.lineno, part.value


def _plain(text: str) -> str:
    """A pattern's blanks as blanks."""
    return text.replace(r"\ ", " ").replace(r"\s+", " ")


def foreign(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of what a test takes and must not: private names, benchmarks, bare namespaces for interfaces."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            module = getattr(node, "module", None) or ""
            for name in (f"{module}.{alias.name}".strip(".") for alias in node.names):
                if name.partition(".")[0] == "benchmarks" or name.endswith("SimpleNamespace") or _is_private(name):
                    yield node.lineno, name
        elif isinstance(node, ast.Attribute):
            is_own = isinstance(node.value, ast.Name) and node.value.id in ("self", "cls", "own", "other")
            if node.attr == "SimpleNamespace" or (_is_private(node.attr) and not is_own):
                yield node.lineno, ast.unparse(node)


def _is_private(name: str) -> bool:
    """Whether a part of it is private; the compiled core is public to tests, and some names are Python's own."""
    parts = set(name.split(".")) - PUBLIC
    return any(part.startswith("_") and not part.endswith("__") for part in parts)


def clocks(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and text of every assertion on how long something took."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            timed = _timed(function)
            for node in ast.walk(function):
                if isinstance(node, ast.Assert) and _reads_a_clock(node.test, timed):
                    yield node.lineno, ast.unparse(node.test)


def _timed(function: ast.FunctionDef) -> set[str]:
    """Names in it that come from a clock."""
    timed: set[str] = set()
    for node in ast.walk(function):
        if isinstance(node, ast.Assign) and _reads_a_clock(node.value, timed):
            timed |= {part.id for target in node.targets for part in ast.walk(target) if _is_stored(part)}
    return timed


def _is_stored(node: ast.AST) -> bool:
    return isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)


def _reads_a_clock(node: ast.AST, timed: set[str]) -> bool:
    return any(
        (isinstance(part, ast.Call) and getattr(part.func, "attr", getattr(part.func, "id", "")) in CLOCKS)
        or (isinstance(part, ast.Name) and part.id in timed)
        for part in ast.walk(node)
    )


def claims(tree: ast.AST) -> Iterator[tuple[str, str, str]]:
    """Test, claim and reference of every call of the fixture `validated`, whose words stand there as they are."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef) and function.name.startswith("test_"):
            for node in ast.walk(function):
                if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "validated":
                    claim, reference = (ast.literal_eval(argument) for argument in node.args[:2])
                    yield function.name, claim, reference


def sources(folder: Path, without: str) -> Iterator[tuple[Path, ast.AST]]:
    """Every module of a folder except those of one below it."""
    for path in sorted(folder.rglob("*.py")):
        if without not in path.relative_to(folder).parts:
            yield path, ast.parse(path.read_text(encoding="utf-8"))
