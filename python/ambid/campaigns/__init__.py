"""Campaigns over bias currents: K_i by closed-loop identification and static loading, K_s and tau_e with scatter."""

from ambid.campaigns.procedure import campaign
from ambid.campaigns.result import BiasPoint, Campaign, Runs

__all__ = ["BiasPoint", "Campaign", "Runs", "campaign"]
