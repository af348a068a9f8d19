"""Stored campaigns as plain data, which `app.campaigns` interprets."""

from dataclasses import dataclass
from typing import Any

from sqlalchemy import delete, insert, update

from app.store.repository import Entries, Entry, Time, require
from app.store.tables import campaigns, new_id, now


class CampaignChanged(ValueError):
    """Another person changed the campaign in the meantime."""


@dataclass(frozen=True)
class StoredCampaign(Entry):
    """A campaign."""

    id: str
    name: str
    created: Time
    changed: Time
    revision: int
    """1, 2, ...: increases with each change"""
    content: dict[str, Any]


class CampaignRepository(Entries[StoredCampaign]):
    """Campaigns by id."""

    table, entry = campaigns, StoredCampaign

    def add(self, name: str, content: dict[str, Any]) -> StoredCampaign:
        at = now()
        row = {"id": new_id(), "created": at, "changed": at, "revision": 1}
        row |= {"name": name, "content": content}
        with self._writing() as connection:
            connection.execute(insert(campaigns).values(**row))
        self.on_change()
        return StoredCampaign(**row)

    def all(self) -> list[StoredCampaign]:
        """All campaigns, last changed first."""
        return sorted(super().all(), key=lambda campaign: campaign.changed, reverse=True)

    def put(self, before: StoredCampaign, content: dict[str, Any]) -> StoredCampaign:
        """Replace the content. CampaignChanged if `before` is not the newest revision."""
        campaign = campaigns.c
        is_newest = campaign.id == before.id, campaign.revision == before.revision
        changes = {"revision": before.revision + 1, "changed": now(), "content": content}
        with self._writing() as connection:
            if (
                connection.execute(update(campaigns).where(*is_newest).values(**changes)).rowcount
                == 0
            ):
                raise CampaignChanged(
                    f"the campaign {before.name!r} was changed by another person: reload it, then "
                    "repeat your change"
                )
        self.on_change()
        return self.info(before.id)

    def delete(self, campaign_id: str) -> None:
        with self._writing() as connection:
            require(connection, campaigns, campaign_id)
            connection.execute(delete(campaigns).where(campaigns.c.id == campaign_id))
        self.on_change()
