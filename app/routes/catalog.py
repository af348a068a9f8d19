"""The catalog of recipe parts with their schemas."""

from typing import Any

from fastapi import APIRouter

from app.catalog import catalog
from app.routes.dependencies import json_response

router = APIRouter(prefix="/api/v1", tags=["catalog"])


@router.get("/catalog")
async def read_catalog() -> dict[str, Any]:
    """All families with the JSON schemas of their parameters, and the recipes made of them.

    `families` by name have `entries` by `kind`, each with `label`, `description`, `schema`,
    `default` and, of aircraft and manoeuvres, the parts that they bring to `usual_tests`. `recipes`
    by name have `schema`, `default`, the `usual` values of a request that gives none, `as_flown`
    with the imperfections of flight, and what they need installed. A property with `x-family` takes
    an entry of that family; `x-unit` is its unit. Angles are in radians unless the name ends in
    `_deg`. `channels` are in the order of y, `known_channels` those of all dictionaries,
    `conditions` those that define flight conditions. `telemetry` has the formats of recordings, the
    targets and units of their signals, and derivations.
    """
    return json_response(catalog(), headers={"Cache-Control": "no-cache"})
