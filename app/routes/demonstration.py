"""The demonstration: how far it is, and its start from a page."""

from dataclasses import asdict
from typing import Annotated

from fastapi import Depends, Request
from pydantic import BaseModel, Field

from app.demonstration import Demonstration, Phase
from app.http.head_requests import Router

router = Router(prefix="/api/v1/demonstration", tags=["demonstration"])


class DemonstrationProgress(BaseModel):
    """How far the demonstration is."""

    phase: Phase
    step: str = Field(description="what is being done, in words")
    share: float = Field(description="of the work done, 0 to 1")
    elapsed: float = Field(description="[s]")
    remaining: float | None = Field(
        description="[s], estimated from the work done; null while too little is done to tell"
    )
    flight: str | None = Field(description="id of its flight; null before `ready`")
    problem: str = Field(description="why it failed; empty otherwise")


def _demonstration(request: Request) -> Demonstration:
    return request.app.state.demonstration


DemonstrationDep = Annotated[Demonstration, Depends(_demonstration)]


@router.get("")
async def read_demonstration(demonstration: DemonstrationDep) -> DemonstrationProgress | None:
    """How far the live demonstration is; null where it was not started."""
    progress = demonstration.progress
    return None if progress is None else DemonstrationProgress(**asdict(progress))


@router.post("", status_code=202)
async def start_demonstration(demonstration: DemonstrationDep) -> DemonstrationProgress | None:
    """Train the demonstration's small monitor where it is missing, and fly a failing flight."""
    demonstration.start()
    return await read_demonstration(demonstration)
