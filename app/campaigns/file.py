"""Read and check a campaign's file; `Campaign.save` writes it."""

from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from app.campaigns.campaign import FORMAT, VERSION, Campaign, CampaignError, Condition, Point
from app.recipes.recipes import RecipeError, from_plain, read_plain
from core.bounds import quoted
from core.clearance.clearance import ClearanceRecipe
from core.planned_test.planned_test import DatasetRecipe

POINTS = TypeAdapter(tuple[Point, ...])


def load(path: Path) -> Campaign:
    """Read a campaign's file; CampaignError if it is not one."""
    return from_file(read_plain(path), str(path))


def from_file(plain: Any, where: str) -> Campaign:
    """Rebuild a campaign from the content of its file.   where: its origin, for errors."""
    if not isinstance(plain, dict) or plain.get("format") != FORMAT:
        raise CampaignError(
            f"{where} is not a campaign file: create one with `forewarn campaign new`"
        )
    if (version := plain.get("version")) not in (1, VERSION):
        raise CampaignError(
            f"{where} is a campaign file of version {version!r}: this program reads up to {VERSION}"
        )
    try:
        if version == 1:
            plain = plain | {"conditions": [{"name": "", "test": plain["test"]}]}
        if not isinstance(plain["name"], str):
            raise CampaignError(f"{where}: name is {quoted(plain['name'])}: give a text")
        return Campaign(
            plain["name"],
            tuple(
                Condition(each["name"], from_plain(DatasetRecipe(), each["test"], "test"))
                for each in plain["conditions"]
            ),
            POINTS.validate_python(plain["points"]),
            from_plain(ClearanceRecipe(), plain["clearance"], "clearance"),
        )
    except KeyError as error:
        raise CampaignError(f"{where} lacks {error}: it is damaged") from None
    except (TypeError, AttributeError) as error:
        raise CampaignError(f"{where} is damaged: {error}") from None
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(map(str, first["loc"]))
        message = str(first["msg"]).removeprefix("Value error, ")
        raise CampaignError(f"{where}: points.{place}: {message}") from None
    except RecipeError as error:
        raise CampaignError(f"{where}: {error}") from None
