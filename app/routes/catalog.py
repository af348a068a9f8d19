"""What the program knows: families of parts with the schema of their parameters."""

from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, NamedTuple

from fastapi import Response
from pydantic import BaseModel, Field
from pydantic.json_schema import models_json_schema

from app.catalog import catalog
from app.http.head_requests import Router
from app.live.messages import UPLINK_DOWN, UPLINK_UP
from app.messages import DOWN, UP
from app.routes.dependencies import json_response
from app.routes.recording_models import Derivable
from core import __version__
from core.channels import Channel
from core.flight_markers import FlightMarkerKind
from core.limit_set import ConditionChannel

STREAMS: dict[int | str, dict[str, Any]] = {
    200: {"content": {"application/json": {"schema": {"type": "object"}}}}
}
router = Router(prefix="/api/v1", tags=["catalog"])


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
    as_flown: dict[str, Any] | None = Field(
        default=None,
        description="of a dataset: the default with noise, jitter and imperfections of a flight",
    )
    usual: dict[str, Any] | None = Field(
        default=None,
        description="of a dataset and a monitor: what an order means that says nothing",
    )


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
    conditions: list[ConditionChannel] = Field(
        description="what the conditions of a limit set are told by"
    )
    families: dict[str, ListedFamily]
    recipes: dict[str, RecipeForm]
    flight_markers: list[FlightMarkerKind] = Field(
        description="what may be called in a flight under way"
    )
    telemetry: Telemetry


@router.get("/catalog", response_model=Catalog)
async def read_catalog():
    """Every family with the JSON schema of its parameters, and the recipes made of them.

    A parameter's unit is its schema's `x-unit`; angles inside are radians, a name that ends in
    `_deg` says degrees.
    """
    return json_response(catalog(), headers={"Cache-Control": "no-cache"})


@router.get("/asyncapi.json", response_class=Response, responses=STREAMS)
async def describe_streams():
    """The WebSocket streams as an AsyncAPI document: which messages are sent and taken."""
    return json_response(_streams())


class _Socket(NamedTuple):
    """A WebSocket of a flight. send: what the server sends.   receive: what it takes."""

    name: str
    description: str
    send: tuple[type[BaseModel], ...]
    receive: tuple[type[BaseModel], ...]


SOCKETS = (
    _Socket(
        "stream",
        "Text frames of JSON. A message of frames costs one credit: give it back.",
        DOWN,
        UP,
    ),
    _Socket(
        "uplink",
        "The source of a live flight: a batch a message, acknowledged once it is durable.",
        UPLINK_DOWN,
        UPLINK_UP,
    ),
)


@cache
def _streams() -> dict[str, Any]:
    """AsyncAPI 3.0 of what each WebSocket of a flight sends (down) and takes (up)."""
    kinds = dict.fromkeys(kind for each in SOCKETS for kind in (*each.send, *each.receive))
    _, schemas = models_json_schema(
        [(kind, "validation") for kind in kinds], ref_template="#/components/schemas/{model}"
    )
    messages = {
        kind.__name__: {
            "contentType": "application/json",
            "payload": {"$ref": f"#/components/schemas/{kind.__name__}"},
        }
        for kind in kinds
    }
    return {
        "asyncapi": "3.0.0",
        "info": {"title": "Forewarn", "version": __version__},
        "channels": {each.name: _described(each) for each in SOCKETS},
        "operations": {
            f"{action}_{each.name}": {
                "action": action,
                "channel": {"$ref": f"#/channels/{each.name}"},
                "messages": [
                    {"$ref": f"#/channels/{each.name}/messages/{kind.__name__}"} for kind in part
                ],
            }
            for each in SOCKETS
            for action, part in (("send", each.send), ("receive", each.receive))
        },
        "components": {"messages": messages, "schemas": schemas["$defs"]},
    }


def _described(channel: _Socket) -> dict[str, Any]:
    return {
        "address": f"/api/v1/flights/{{flight_id}}/{channel.name}",
        "description": channel.description,
        "parameters": {"flight_id": {"description": "a flight that is under way"}},
        "messages": {
            kind.__name__: {"$ref": f"#/components/messages/{kind.__name__}"}
            for kind in (*channel.send, *channel.receive)
        },
    }
