"""What the program knows: families of parts with the schema of their parameters."""

from dataclasses import dataclass
from typing import Annotated, Any

from fastapi import APIRouter
from pydantic import BaseModel, Field

from app.catalog import catalog
from app.routes.dependencies import json_response
from app.routes.recording_models import Derivable
from core.channels import Channel

router = APIRouter(prefix="/api/v1", tags=["catalog"])


class Member(BaseModel):
    """A member of a family."""

    kind: str = Field(description="what `kind` says in a recipe", examples=["rudder_doublet"])
    label: str
    description: str = Field(description="what it is and where its numbers come from")
    schema_: dict[str, Any] = Field(alias="schema", description="JSON schema of its parameters")
    default: dict[str, Any] = Field(description="the parameters as they are unless said otherwise")
    usual_test: dict[str, Any] | None = Field(
        default=None,
        description="of an aircraft: law, manoeuvre and limits that a dataset's recipe begins with",
    )


class ListedFamily(BaseModel):
    """Interchangeable parts, by kind."""

    label: str
    description: str
    entries: dict[str, Member]


class RecipeForm(BaseModel):
    """A recipe's schema; a property with `x-family` takes an entry of that family."""

    schema_: dict[str, Any] = Field(alias="schema", description="JSON schema; `x-unit` says units")
    default: dict[str, Any]


class ListedFormat(BaseModel):
    """A format that recordings are read from."""

    key: str
    title: str
    endings: list[str] = Field(description="of names, the usual one first", examples=[[".csv"]])
    extra: str | None = Field(description="to install with the program to read it, if any")
    installed: bool = Field(description="whether that is there")
    experimental: bool = Field(description="not proven on files of many recorders")


@dataclass(frozen=True)
class Target(Channel):
    """What a signal of a recording can be: a channel, or what one is made of."""

    units: Annotated[list[str], Field(description="common ones, its own first")]


class ListedDerivation(Derivable):
    """A way to make a channel, the target, out of others."""

    target: str


class Telemetry(BaseModel):
    """What recordings can be read from, and what their signals can be."""

    formats: list[ListedFormat]
    targets: list[Target]
    time_units: list[str] = Field(description="common ones, seconds first")
    derivations: list[ListedDerivation]


class Catalog(BaseModel):
    """Channels in the order of y, families, the recipes made of them, and recorded telemetry."""

    version: str
    channels: list[Channel]
    families: dict[str, ListedFamily]
    recipes: dict[str, RecipeForm]
    telemetry: Telemetry


@router.get("/catalog", response_model=Catalog)
async def read_catalog():
    """Every family with the JSON schema of its parameters, and the recipes made of them.

    A parameter's unit is its schema's `x-unit`; angles inside are radians, a name that ends in
    `_deg` says degrees.
    """
    return json_response(catalog(), headers={"Cache-Control": "no-cache"})
