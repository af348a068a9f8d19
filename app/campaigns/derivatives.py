"""The derivatives identified after each complete point, as plain data."""

from typing import Any

from app.campaigns.campaign import Campaign
from app.campaigns.clearing import identified
from core.clearance.identification import Identification


def derivatives(campaign: Campaign) -> list[dict[str, Any]]:
    """Identifications at each flight condition, after each of its complete points."""
    return [
        {"condition": condition.name, "after": after}
        for condition in campaign.conditions
        if (after := [identification_plain(each) for each in history(campaign, condition.name)])
    ]


def history(campaign: Campaign, condition: str) -> list[Identification]:
    """Identifications after the first complete point, after the second, and so on."""
    n_flown = len(campaign.flown(condition))
    return [identified(campaign, condition, first) for first in range(1, n_flown + 1)]


def identification_plain(identification: Identification) -> dict[str, Any]:
    """An identification as plain data; before and after are [mean, sigma]."""
    return {
        "sources": list(identification.sources),
        "parameters": [
            {
                "name": name,
                "before": [identification.prior_mean[k], identification.prior_sigma[k]],
                "after": [identification.mean[k], identification.sigma[k]],
                "determined": name not in identification.undetermined,
            }
            for k, name in enumerate(identification.names)
        ],
        "covariance": identification.covariance.tolist(),
        "r2": identification.r2.tolist(),
        "distance": identification.distance,
        "noise": identification.noise.tolist(),
    }
