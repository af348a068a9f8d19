"""Markers and notes at a time or an interval of a recording."""

import asyncio

from pydantic import BaseModel, ConfigDict, Field, model_validator

from app.http.head_requests import Router
from app.http.problems import problem_responses
from app.routes.dependencies import StoreDep
from app.routes.recording_models import Number
from app.store.markers import Marker, MarkerKind
from app.store.tables import new_id, now

router = Router(prefix="/api/v1/recordings/{recording_id}/markers", tags=["recordings"])


class MarkerText(BaseModel):
    """A remark and its time."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        json_schema_extra={"examples": [{"t": 12.5, "text": "gust"}]},
    )

    t: Number = Field(description="[s]")
    end: Number | None = Field(
        default=None, description="end of an interval [s]; null for a moment"
    )
    text: str = Field(min_length=1, max_length=2000)
    kind: MarkerKind = "marker"

    @model_validator(mode="after")
    def check_order(self) -> "MarkerText":
        if self.end is not None and self.end < self.t:
            raise ValueError(
                f"the end {self.end:g} s is before the start {self.t:g} s: give a later end"
            )
        return self


@router.get("", responses=problem_responses(404))
async def list_markers(recording_id: str, store: StoreDep) -> list[Marker]:
    """All markers and notes of a recording, in order of time."""
    return await asyncio.to_thread(store.markers.of, recording_id)


@router.post("", status_code=201, responses=problem_responses(404, 422))
async def add_marker(recording_id: str, text: MarkerText, store: StoreDep) -> Marker:
    """Add a marker or a note."""
    marker = Marker(id=new_id(), created=now(), **text.model_dump())
    return await asyncio.to_thread(store.markers.add, recording_id, marker)


@router.put("/{marker_id}", responses=problem_responses(404, 422))
async def change_marker(
    recording_id: str, marker_id: str, text: MarkerText, store: StoreDep
) -> Marker:
    """Change a marker's text or time."""
    marker = Marker(id=marker_id, created="", **text.model_dump())
    return await asyncio.to_thread(store.markers.update, recording_id, marker)


@router.delete("/{marker_id}", status_code=204, responses=problem_responses(404))
async def delete_marker(recording_id: str, marker_id: str, store: StoreDep) -> None:
    """Delete a marker."""
    await asyncio.to_thread(store.markers.delete, recording_id, marker_id)
