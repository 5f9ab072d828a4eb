"""What was measured: records of the closed loop and static loadings, from files or arrays, behind their gates."""

from ambid.record.channel_map import ChannelMap
from ambid.record.record import Record
from ambid.record.static_loading import StaticLoading

__all__ = ["ChannelMap", "Record", "StaticLoading"]
