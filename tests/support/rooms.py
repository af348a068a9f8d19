"""`python -m tests.support.rooms`: the house in numbers, and an error where it outgrows its bounds.

A room is a folder or top file of `app`, or `core` as a whole; an arrow is a pair of rooms of which
one imports the other. Lines are those of the product: .py, .js, .css and .html.
"""

from collections import Counter
from pathlib import Path

import grimp

from tests.support.places import ROOT

MOST_ROOMS = 28
MOST_ARROWS = 125
MOST_FILES = 20
PRODUCT = ("app", "core", "static", "alembic")
SUFFIXES = (".py", ".js", ".css", ".html")


def arrows() -> set[tuple[str, str]]:
    """(importer, imported) pairs of rooms."""
    graph = grimp.build_graph("core", "app")
    return {
        pair
        for module in graph.modules
        for imported in graph.find_modules_directly_imported_by(module)
        if len(set(pair := (_room(module), _room(imported)))) == 2
    }


def files() -> list[Path]:
    """Files of the product, relative to the project's folder."""
    return [
        path.relative_to(ROOT)
        for part in PRODUCT
        for path in (ROOT / part).rglob("*")
        if path.suffix in SUFFIXES
    ]


def _room(module: str) -> str:
    package, *rest = module.split(".")
    return package if package == "core" or not rest else f"{package}.{rest[0]}"


def main() -> None:
    pairs, product = arrows(), files()
    rooms = {room for pair in pairs for room in pair}
    lines = {path: len((ROOT / path).read_text().splitlines()) for path in product}
    parts = Counter[str]()
    for path, n in lines.items():
        parts[path.parts[0]] += n
    print(f"{len(rooms)} rooms, {len(pairs)} arrows (at most {MOST_ROOMS} and {MOST_ARROWS})")
    print(f"{sum(parts.values()):,} lines:", ", ".join(f"{k} {n:,}" for k, n in parts.items()))
    print(sum(path.suffix == ".py" for path in product), "Python files")
    folders = Counter(str(path.parent) for path in product if path.name != "__init__.py")
    for folder, n in folders.most_common():
        if n > MOST_FILES:
            print(f"{folder}: {n} files")
    for path in sorted(lines, key=lines.__getitem__, reverse=True):
        if lines[path] > 400:
            print(f"{path}: {lines[path]} lines")
    if len(rooms) > MOST_ROOMS or len(pairs) > MOST_ARROWS:
        raise SystemExit("the house outgrew its bounds: merge rooms, or turn an import around")


if __name__ == "__main__":
    main()
