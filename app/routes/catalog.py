"""The catalog of recipe parts with their schemas, and the description of the streams."""

from functools import cache
from typing import Any, NamedTuple

from fastapi import APIRouter, Response
from pydantic import BaseModel, Field
from pydantic.json_schema import models_json_schema

from app.catalog import catalog
from app.messages import DOWN, UP, UPLINK_DOWN, UPLINK_UP
from app.routes.dependencies import json_response
from app.routes.recordings import Derivable, Target
from core import __version__
from core.channels import Channel
from core.conditions import ConditionChannel
from core.flight_events import FlightMarkerKind

STREAMS: dict[int | str, dict[str, Any]] = {
    200: {"content": {"application/json": {"schema": {"type": "object"}}}}
}
router = APIRouter(prefix="/api/v1", tags=["catalog"])


class Member(BaseModel):
    """A member of a family."""

    kind: str = Field(description="value of `kind` in a recipe", examples=["rudder_doublet"])
    label: str
    description: str = Field(description="what it is, and the source of its numbers")
    schema_: dict[str, Any] = Field(alias="schema", description="JSON schema of its parameters")
    default: dict[str, Any] = Field(description="default parameters")
    usual_tests: dict[str, dict[str, Any]] = Field(
        default={},
        description=(
            "by recipe, the parts that it brings to a test: of a linear aircraft control law, "
            "manoeuvre and limits, of a manoeuvre condition, limits and pilot"
        ),
    )


class ListedFamily(BaseModel):
    """Interchangeable parts, by kind."""

    label: str
    description: str
    entries: dict[str, Member]


class RecipeForm(BaseModel):
    """A recipe's schema; a property with `x-family` takes an entry of that family."""

    schema_: dict[str, Any] = Field(
        alias="schema", description="JSON schema with units in `x-unit`"
    )
    default: dict[str, Any]
    needs: str = Field(default="", description="what must be installed to simulate it")
    as_flown: dict[str, Any] | None = Field(
        default=None,
        description="for a dataset: the default with the noise, jitter and imperfections of flight",
    )
    usual: dict[str, Any] | None = Field(
        default=None,
        description="for a dataset or a monitor: the values used where a request gives none",
    )


class ListedFormat(BaseModel):
    """A format that recordings are read from."""

    key: str
    title: str
    endings: list[str] = Field(
        description="file name endings, the usual one first", examples=[[".csv"]]
    )
    extra: str | None = Field(description="optional dependency that reads it, if any")
    installed: bool = Field(description="whether its reader is installed")
    experimental: bool = Field(description="not yet tested on files of many recorders")


class ListedDerivation(Derivable):
    """A derivation of a channel, the target, from others."""

    target: str


class Telemetry(BaseModel):
    """Formats of recordings, and targets and units for their signals."""

    formats: list[ListedFormat]
    targets: list[Target]
    time_units: list[str] = Field(description="common units of time, seconds first")
    derivations: list[ListedDerivation]


class Catalog(BaseModel):
    """Channels in the order of y, families, recipes made of them, and telemetry formats."""

    version: str
    channels: list[Channel]
    known_channels: list[Channel] = Field(
        description="channels of all dictionaries, by whose keys parameters are named"
    )
    conditions: list[ConditionChannel] = Field(
        description="channels that define the flight conditions of a limit set"
    )
    families: dict[str, ListedFamily]
    recipes: dict[str, RecipeForm]
    calibrating_share: float = Field(
        description="share of the failing flights of own rollouts that calibrate a monitor"
    )
    flight_markers: list[FlightMarkerKind] = Field(
        description="markers that can be set during a flight"
    )
    telemetry: Telemetry


@router.get("/catalog")
async def read_catalog() -> Catalog:
    """All families with the JSON schemas of their parameters, and the recipes made of them.

    `x-unit` of a schema is the unit of the parameter. Angles are in radians unless the name ends in
    `_deg`.
    """
    return json_response(catalog(), headers={"Cache-Control": "no-cache"})


@router.get("/asyncapi.json", response_class=Response, responses=STREAMS)
async def describe_streams():
    """The messages of the WebSocket streams as an AsyncAPI document."""
    return json_response(_streams())


class _Socket(NamedTuple):
    """A WebSocket of a flight. send, receive: messages as seen from the server."""

    name: str
    description: str
    send: tuple[type[BaseModel], ...]
    receive: tuple[type[BaseModel], ...]


SOCKETS = (
    _Socket(
        "stream",
        "Text frames of JSON. A message of frames costs one credit; grant it again. A screen "
        "that follows or leads a replay has an id of its choice as the parameter `screen`.",
        DOWN,
        UP,
    ),
    _Socket(
        "uplink",
        "The source of a live flight: one batch per message, acknowledged once durable.",
        UPLINK_DOWN,
        UPLINK_UP,
    ),
)


@cache
def _streams() -> dict[str, Any]:
    """AsyncAPI 3.0 document of the messages of each WebSocket of a flight."""
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
        "parameters": {"flight_id": {"description": "id of a flight in progress"}},
        "messages": {
            kind.__name__: {"$ref": f"#/components/messages/{kind.__name__}"}
            for kind in (*channel.send, *channel.receive)
        },
    }
