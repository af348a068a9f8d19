"""What the program knows: families of parts with the schema of their parameters."""

from typing import Any

from fastapi import APIRouter
from pydantic import BaseModel, Field

from app.catalog import catalog
from app.routes.dependencies import json_response

router = APIRouter(prefix="/api/v1", tags=["catalog"])


class Channel(BaseModel):
    """One channel of the telemetry."""

    key: str = Field(examples=["Ny"])
    symbol: str = Field(examples=["N_y"])
    unit: str = Field(description="SI unit, or g", examples=["g"])
    label: str = Field(examples=["lateral acceleration"])


class Entry(BaseModel):
    """A member of a family."""

    kind: str = Field(description="what `kind` says in a recipe", examples=["rudder_doublet"])
    label: str
    description: str = Field(description="what it is and where its numbers come from")
    schema_: dict[str, Any] = Field(alias="schema", description="JSON schema of its parameters")
    default: dict[str, Any] = Field(description="the parameters as they are unless said otherwise")


class Family(BaseModel):
    """Interchangeable parts, by kind."""

    label: str
    description: str
    entries: dict[str, Entry]


class RecipeForm(BaseModel):
    """A recipe's schema; a property with `x-family` takes an entry of that family."""

    schema_: dict[str, Any] = Field(alias="schema", description="JSON schema; `x-unit` says units")
    default: dict[str, Any]


class Format(BaseModel):
    """A format that recordings are read from."""

    key: str
    title: str
    endings: list[str] = Field(description="of names, the usual one first", examples=[[".csv"]])
    extra: str | None = Field(description="to install with the program to read it, if any")
    installed: bool = Field(description="whether that is there")
    experimental: bool = Field(description="not proven on files of many recorders")


class Target(Channel):
    """What a signal of a recording can be: a channel, or what one is made of."""

    units: list[str] = Field(description="common ones, its own first")


class Derivation(BaseModel):
    """A way to make a channel out of others."""

    key: str
    target: str
    title: str
    needs: list[str]


class Telemetry(BaseModel):
    """What recordings can be read from, and what their signals can be."""

    formats: list[Format]
    targets: list[Target]
    time_units: list[str] = Field(description="common ones, seconds first")
    derivations: list[Derivation]


class Catalog(BaseModel):
    """Channels in the order of y, families, the recipes made of them, and recorded telemetry."""

    version: str
    channels: list[Channel]
    families: dict[str, Family]
    recipes: dict[str, RecipeForm]
    telemetry: Telemetry


@router.get("/catalog", response_model=Catalog)
async def read_catalog():
    """Every family with the JSON schema of its parameters, and the recipes made of them.

    A parameter's unit is its schema's `x-unit`; angles inside are radians, a name that ends in
    `_deg` says degrees.
    """
    return json_response(catalog(), headers={"Cache-Control": "no-cache"})
