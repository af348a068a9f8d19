"""Storage: disk usage, and flights and recordings kept permanently."""

import asyncio

from pydantic import BaseModel, ConfigDict

from app.http.head_requests import Router
from app.http.problems import problem_responses
from app.routes.dependencies import JournalsDep, RecordingsDep, SettingsDep, StoreDep
from app.upkeep.usage import DiskSpace, StorageUsage, space_of, usage_of

router = Router(prefix="/api/v1", tags=["storage"])


class Keeping(BaseModel):
    """Whether an item is kept permanently; it can then not be deleted."""

    model_config = ConfigDict(
        extra="forbid", strict=True, json_schema_extra={"examples": [{"keep": True}]}
    )

    keep: bool


@router.get("/storage")
async def read_storage(
    recordings: RecordingsDep, journals: JournalsDep, settings: SettingsDep
) -> StorageUsage:
    """Disk usage of the database, the files and each kind; largest and oldest items; free space.

    Sizes are in bytes. `warning` is not empty if the disk is nearly full.
    """
    return await asyncio.to_thread(usage_of, recordings, journals, settings.data_dir)


@router.get("/storage/space")
async def read_space(settings: SettingsDep) -> DiskSpace:
    """Free space on the disk of the data [bytes], with a warning if it is nearly full."""
    return await asyncio.to_thread(space_of, settings.data_dir)


@router.put("/flights/{flight_id}/keep", responses=problem_responses(404, 422))
async def keep_flight(flight_id: str, keeping: Keeping, store: StoreDep) -> Keeping:
    """Keep a flight permanently, or release it."""
    await asyncio.to_thread(store.retention_flags.set_flight, flight_id, keeping.keep)
    return keeping


@router.put("/recordings/{recording_id}/keep", responses=problem_responses(404, 422))
async def keep_recording(recording_id: str, keeping: Keeping, store: StoreDep) -> Keeping:
    """Keep a recording permanently, or release it."""
    await asyncio.to_thread(store.retention_flags.set_recording, recording_id, keeping.keep)
    return keeping
