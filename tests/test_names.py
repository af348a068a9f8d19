"""Names: one word, one thing."""

import ast
from collections import Counter

from tests.support.places import ROOT


def test_no_public_class_name_means_two_things():
    names = Counter(
        node.name
        for top in ("app", "core")
        for file in (ROOT / top).rglob("*.py")
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    assert [name for name, times in names.items() if times > 1] == []
