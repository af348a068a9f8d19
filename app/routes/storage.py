"""Storage: the disk that what is stored takes, and what is kept for ever."""

import asyncio

from pydantic import BaseModel, ConfigDict

from app.http.head_requests import Router
from app.http.problems import problem_responses
from app.routes.dependencies import JournalsDep, RecordingsDep, SettingsDep, StoreDep
from app.upkeep.usage import DiskSpace, StorageUsage, space_of, usage_of

router = Router(prefix="/api/v1", tags=["storage"])


class Keeping(BaseModel):
    """Whether something is kept for ever: neither retention nor anybody deletes it then."""

    model_config = ConfigDict(
        extra="forbid", strict=True, json_schema_extra={"examples": [{"keep": True}]}
    )

    keep: bool


@router.get("/storage")
async def read_storage(
    recordings: RecordingsDep, journals: JournalsDep, settings: SettingsDep
) -> StorageUsage:
    """What database, files and each kind take, what is largest and oldest, and what is left.

    Sizes are in bytes. A warning is said where the disk is short.
    """
    return await asyncio.to_thread(usage_of, recordings, journals, settings.data_dir)


@router.get("/storage/space")
async def read_space(settings: SettingsDep) -> DiskSpace:
    """How much the disk of the data has left [bytes], with a warning where it is short."""
    return await asyncio.to_thread(space_of, settings.data_dir)


@router.put("/flights/{flight_id}/keep", responses=problem_responses(404, 422))
async def keep_flight(flight_id: str, keeping: Keeping, store: StoreDep) -> Keeping:
    """Keep a flight for ever, or release it."""
    await asyncio.to_thread(store.retention_flags.set_flight, flight_id, keeping.keep)
    return keeping


@router.put("/recordings/{recording_id}/keep", responses=problem_responses(404, 422))
async def keep_recording(recording_id: str, keeping: Keeping, store: StoreDep) -> Keeping:
    """Keep a recording for ever, or release it."""
    await asyncio.to_thread(store.retention_flags.set_recording, recording_id, keeping.keep)
    return keeping
