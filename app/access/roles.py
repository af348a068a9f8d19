"""Permissions: one table of methods and routes by role.

A route that is missing in the table is for admins only, and a test fails until it is added.
"""

import re
from dataclasses import dataclass
from functools import cache, lru_cache

from app.store.tokens import ROLES, Role

API = "/api/v1"
FLIGHT, RECORDING = f"{API}/flights/{{id}}", f"{API}/recordings/{{id}}"
CAMPAIGN = f"{API}/campaigns/{{id}}"
SCORING = f"{RECORDING}/scorings/{{id}}"
WEBSOCKET = "WEBSOCKET"
"""The method in the table for a WebSocket."""
UPLINK = f"{WEBSOCKET} {FLIGHT}/uplink"
SAMPLES = f"POST {FLIGHT}/samples"

ALLOWED: dict[Role, tuple[str, ...]] = {
    "viewer": (
        "GET /",
        "GET /index.html",
        "GET /icon.svg",
        "GET /{name}.css",
        "GET /js/{path:path}",
        "GET /guide",
        "GET /guide/{slug}",
        "GET /guide/pictures/{name}",
        "GET /docs",
        "GET /docs/start.js",
        "GET /docs/assets/{path:path}",
        "GET /openapi.json",
        "GET /healthz",
        "GET /readyz",
        "GET /metrics",
        "GET /scene/{flight}/",
        f"{WEBSOCKET} /scene/{{flight}}",
        f"GET {API}/me",
        f"GET {API}/integrity",
        f"GET {API}/storage",
        f"GET {API}/storage/space",
        f"GET {API}/catalog",
        f"GET {API}/demonstration",
        f"GET {API}/asyncapi.json",
        f"GET {API}/datasets",
        f"GET {API}/datasets/{{id}}",
        f"GET {API}/datasets/{{id}}/arrays",
        f"GET {API}/datasets/{{id}}/rollouts",
        f"GET {API}/datasets/{{id}}/rollouts/{{n}}",
        f"GET {API}/monitors",
        f"GET {API}/monitors/{{id}}",
        f"GET {API}/monitors/{{id}}/calibration",
        f"GET {API}/monitors/{{id}}/evaluation",
        f"GET {API}/monitors/{{id}}/certificate",
        f"GET {API}/monitors/{{id}}/file",
        f"GET {API}/recordings",
        f"GET {RECORDING}",
        f"GET {RECORDING}/signals/{{index}}/preview",
        f"POST {RECORDING}/preview",
        f"GET {RECORDING}/manoeuvres",
        f"GET {RECORDING}/training-proposal",
        f"GET {RECORDING}/markers",
        f"GET {RECORDING}/scorings",
        f"GET {SCORING}",
        f"GET {SCORING}/assessments",
        f"GET {SCORING}/tiles",
        f"GET {SCORING}/report",
        f"GET {SCORING}/export",
        f"GET {API}/jobs",
        f"GET {API}/jobs/{{id}}",
        f"GET {API}/jobs/{{id}}/events",
        f"GET {API}/jobs/{{id}}/figures/{{name}}",
        f"GET {API}/flights",
        f"GET {FLIGHT}",
        f"GET {FLIGHT}/assessments",
        f"GET {FLIGHT}/samples",
        f"GET {FLIGHT}/source",
        f"GET {FLIGHT}/alarms",
        f"GET {FLIGHT}/markers",
        f"GET {FLIGHT}/limits",
        f"GET {API}/limit-sets",
        f"GET {API}/limit-sets/{{id}}",
        f"GET {API}/limit-sets/{{id}}/versions/{{n}}",
        f"{WEBSOCKET} {FLIGHT}/stream",
        f"GET {API}/campaigns",
        f"GET {CAMPAIGN}",
        f"GET {CAMPAIGN}/file",
        f"GET {CAMPAIGN}/derivatives",
        f"GET {CAMPAIGN}/report",
    ),
    "operator": (
        f"POST {API}/flights",
        f"POST {FLIGHT}/end",
        f"POST {FLIGHT}/transport",
        f"POST {FLIGHT}/alarms/{{id}}/acknowledge",
        f"POST {FLIGHT}/markers",
        f"POST {FLIGHT}/manoeuvre",
        f"POST {FLIGHT}/sender",
        SAMPLES,
        UPLINK,
        f"POST {FLIGHT}/score",
        f"POST {API}/monitors/{{id}}/score",
        f"POST {API}/recordings",
        f"POST {RECORDING}/scorings",
        f"POST {RECORDING}/markers",
        f"PUT {RECORDING}/markers/{{id}}",
        f"POST {CAMPAIGN}/hold",
        f"POST {CAMPAIGN}/abort",
        f"POST {CAMPAIGN}/flown",
    ),
    "engineer": (
        f"POST {API}/datasets",
        f"POST {API}/datasets/amplitude",
        f"DELETE {API}/datasets/{{id}}",
        f"POST {API}/monitors",
        f"POST {API}/monitors/combinations",
        f"DELETE {API}/monitors/{{id}}",
        f"POST {API}/monitors/{{id}}/epsilon",
        f"POST {API}/demonstration",
        f"POST {API}/studies",
        f"POST {API}/sweeps",
        f"POST {API}/jobs/{{id}}/cancel",
        f"PUT {RECORDING}/mapping",
        f"PUT {RECORDING}/keep",
        f"PUT {FLIGHT}/keep",
        f"PUT {FLIGHT}/limits",
        f"POST {API}/limit-sets",
        f"POST {API}/limit-sets/{{id}}/versions",
        f"DELETE {RECORDING}",
        f"DELETE {RECORDING}/markers/{{id}}",
        f"DELETE {SCORING}",
        f"DELETE {FLIGHT}",
        f"POST {API}/campaigns",
        f"POST {API}/campaigns/file",
        f"POST {CAMPAIGN}/conditions",
        f"POST {CAMPAIGN}/confirm",
        f"POST {CAMPAIGN}/clearance",
        f"POST {CAMPAIGN}/monitor",
        f"DELETE {CAMPAIGN}",
    ),
    "admin": (
        f"GET {API}/tokens",
        f"POST {API}/tokens",
        f"DELETE {API}/tokens/{{id}}",
        f"POST {API}/tokens/{{id}}/link",
        f"GET {API}/audit",
    ),
}
"""By the least role needed. `{name}` matches one part of a path, `{name:path}` any number."""
CHANGES_NOTHING = (
    f"POST {RECORDING}/preview",
    f"POST {API}/monitors/{{id}}/score",
    f"POST {FLIGHT}/score",
)
"""POST requests that only compute."""
LOGGED_ONCE = (SAMPLES, UPLINK)
"""The audit log has only the first of each person and flight."""


@dataclass(frozen=True)
class Rule:
    """The least role for a route. route: as in ALLOWED; empty if the table lacks it."""

    role: Role
    route: str = ""


def rule_of(method: str, path: str) -> Rule:
    """The rule for a request; HEAD and OPTIONS count as GET."""
    return _match("GET" if method in ("HEAD", "OPTIONS") else method, path)


@lru_cache(maxsize=4096)
def _match(method: str, path: str) -> Rule:
    request = f"{method} {path}"
    matching = (rule for pattern, rule in _rules() if pattern.fullmatch(request))
    return next(matching, Rule("admin"))


def may(role: Role, needed: Role) -> bool:
    return ROLES.index(role) >= ROLES.index(needed)


def allowed_to(role: Role) -> list[str]:
    """Routes of the table that a role may use, parameters as `{}`."""
    return sorted(_nameless(rule.route) for _, rule in _rules() if may(role, rule.role))


def _nameless(route: str) -> str:
    return re.sub(r"{[^}]*}", "{}", route)


@cache
def _rules() -> list[tuple[re.Pattern[str], Rule]]:
    return [
        (_pattern(route), Rule(role, route)) for role, routes in ALLOWED.items() for route in routes
    ]


def _pattern(route: str) -> re.Pattern[str]:
    pieces = re.split(r"({[^}]*})", route)
    patterns = [
        re.escape(piece) if not piece.startswith("{") else ".*" if ":path" in piece else "[^/]+"
        for piece in pieces
    ]
    return re.compile("".join(patterns), re.DOTALL)
