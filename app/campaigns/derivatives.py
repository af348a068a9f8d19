"""What the complete points say of the aircraft, point after point, as plain data."""

from typing import Any

from app.campaigns.campaign import Campaign
from app.campaigns.clearing import identified
from core.identification.identification import Identification


def derivatives(campaign: Campaign) -> list[dict[str, Any]]:
    """The aircraft at each flight condition, as known after each of its complete points."""
    return [
        {"condition": condition.name, "after": after}
        for condition in campaign.conditions
        if (after := [identification_plain(one) for one in history(campaign, condition.name)])
    ]


def history(campaign: Campaign, condition: str) -> list[Identification]:
    """After the first complete point of a flight condition, after the second, and so on."""
    n_flown = len(campaign.flown(condition))
    return [identified(campaign, condition, first) for first in range(1, n_flown + 1)]


def identification_plain(found: Identification) -> dict[str, Any]:
    """An identification as plain data: each parameter as [mean, sigma], before and after."""
    return {
        "sources": list(found.sources),
        "parameters": [
            {
                "name": name,
                "before": [found.prior_mean[k], found.prior_sigma[k]],
                "after": [found.mean[k], found.sigma[k]],
                "determined": name not in found.undetermined,
            }
            for k, name in enumerate(found.names)
        ],
        "covariance": found.covariance.tolist(),
        "r2": found.r2.tolist(),
        "distance": found.distance,
        "noise": found.noise.tolist(),
    }
