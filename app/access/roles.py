"""Permissions: one table of methods and routes by role.

A route that is missing in the table is for admins only, and a test fails until it is added.
"""

import re
from dataclasses import dataclass
from functools import cache, lru_cache

from app.store.people import ROLES, Role

API = "/api/v1"
FLIGHT, RECORDING = f"{API}/flights/{{id}}", f"{API}/recordings/{{id}}"
CAMPAIGN = f"{API}/campaigns/{{id}}"
WEBSOCKET = "WEBSOCKET"
"""The method in the table for a WebSocket."""
UPLINK = f"{WEBSOCKET} {FLIGHT}/uplink"
SAMPLES = f"POST {FLIGHT}/samples"

READABLE = (
    "archives",
    "campaigns",
    "catalog",
    "datasets",
    "demonstration",
    "events",
    "flights",
    "integrity",
    "jobs",
    "limit-sets",
    "me",
    "monitor-sets",
    "monitors",
    "recordings",
    "storage",
)
"""Resources that everyone may read."""
ALLOWED: dict[Role, tuple[str, ...]] = {
    "viewer": (
        "GET /",
        "GET /index.html",
        "GET /icon.svg",
        "GET /{name}.css",
        "GET /js/{path:path}",
        "GET /guide{path:path}",
        "GET /docs{path:path}",
        "GET /grafana/forewarn.json",
        "GET /openapi.json",
        "GET /healthz",
        "GET /readyz",
        "GET /metrics",
        "GET /scene/{flight}/",
        f"{WEBSOCKET} /scene/{{flight}}",
        f"{WEBSOCKET} {FLIGHT}/stream",
        *(f"GET {API}/{name}" for name in READABLE),
        *(f"GET {API}/{name}/{{path:path}}" for name in READABLE),
        f"POST {RECORDING}/preview",
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
        f"POST {API}/datasets/preview",
        f"DELETE {API}/datasets/{{id}}",
        f"POST {API}/monitors",
        f"POST {API}/monitors/combinations",
        f"DELETE {API}/monitors/{{id}}",
        f"POST {API}/monitors/{{id}}/epsilon",
        f"POST {API}/monitors/{{id}}/airframe",
        f"DELETE {API}/monitors/{{id}}/airframe",
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
        f"POST {API}/monitor-sets",
        f"DELETE {API}/monitor-sets/{{id}}",
        f"DELETE {RECORDING}",
        f"DELETE {RECORDING}/markers/{{id}}",
        f"DELETE {RECORDING}/scorings/{{id}}",
        f"DELETE {FLIGHT}",
        f"POST {API}/campaigns",
        f"POST {API}/campaigns/file",
        f"POST {CAMPAIGN}/conditions",
        f"POST {CAMPAIGN}/confirm",
        f"POST {CAMPAIGN}/smaller-step",
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
    f"POST {API}/datasets/preview",
    f"POST {API}/monitors/{{id}}/score",
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
    routes = (rule.route for _, rule in _rules() if may(role, rule.role))
    return sorted(re.sub(r"{[^}]*}", "{}", route) for route in routes)


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
