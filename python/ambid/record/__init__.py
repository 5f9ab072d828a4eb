"""What was measured, behind its gates: records of the loop, frequency responses, and static loadings."""

from ambid.record.channel_map import ChannelMap
from ambid.record.frequency_response import FrequencyResponse
from ambid.record.measurement import Measurement, Source, load_measurement, measured
from ambid.record.record import Record
from ambid.record.static_loading import StaticLoading

__all__ = [
    "ChannelMap",
    "FrequencyResponse",
    "Measurement",
    "Record",
    "Source",
    "StaticLoading",
    "load_measurement",
    "measured",
]
