"""What recordings can be read from, and what their signals can be: a part of the catalog."""

import re
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, requires, version
from typing import Any

from app.telemetry.formats import FORMATS
from app.telemetry.mapping.derivations import DERIVATIONS
from app.telemetry.targets import TARGETS
from app.telemetry.units import choices


def telemetry_catalog() -> dict[str, Any]:
    """Formats, targets with their units, units of time, and derivations, as plain data."""
    return {
        "formats": [
            {
                "key": known.key,
                "title": known.title,
                "endings": list(known.endings),
                "extra": known.extra or None,
                "installed": is_installed(known.extra),
                "experimental": known.experimental,
            }
            for known in FORMATS.values()
        ],
        "targets": [
            asdict(target) | {"units": choices(target.unit)} for target in TARGETS.values()
        ],
        "time_units": choices("s"),
        "derivations": [
            {"key": way.key, "target": way.target, "title": way.title, "needs": list(way.needs)}
            for way in DERIVATIONS.values()
        ],
    }


def is_installed(extra: str) -> bool:
    """Whether the packages of an extra of this program are there; those of "" always are."""
    names = re.compile(rf"([\w.-]+).*\bextra == ['\"]{extra}['\"]")
    try:
        for requirement in requires("forewarn") or () if extra else ():
            if found := names.match(requirement):
                version(found[1])
    except PackageNotFoundError:
        return False
    return True
