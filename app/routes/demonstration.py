"""The live demonstration: its progress, and its start from a page."""

from dataclasses import asdict
from typing import Annotated

from fastapi import Depends, Request
from pydantic import BaseModel, Field

from app.demonstration import Demonstration, Phase
from app.http.head_requests import Router

router = Router(prefix="/api/v1/demonstration", tags=["demonstration"])


class DemonstrationProgress(BaseModel):
    """Progress of the live demonstration."""

    phase: Phase
    step: str = Field(description="current step, in words")
    share: float = Field(description="share of the work done, 0 to 1")
    elapsed: float = Field(description="[s]")
    remaining: float | None = Field(
        description="[s], estimated from the work done; null while too little is done"
    )
    flight: str | None = Field(description="id of its flight; null before `ready`")
    problem: str = Field(description="why it failed; empty otherwise")


def _demonstration(request: Request) -> Demonstration:
    return request.app.state.demonstration


DemonstrationDep = Annotated[Demonstration, Depends(_demonstration)]


@router.get("")
async def read_demonstration(demonstration: DemonstrationDep) -> DemonstrationProgress | None:
    """Progress of the live demonstration; null before it is started."""
    progress = demonstration.progress
    return None if progress is None else DemonstrationProgress(**asdict(progress))


@router.post("", status_code=202)
async def start_demonstration(demonstration: DemonstrationDep) -> DemonstrationProgress | None:
    """Start the demonstration: train its small monitor if missing, then fly a failing flight."""
    demonstration.start()
    return await read_demonstration(demonstration)
