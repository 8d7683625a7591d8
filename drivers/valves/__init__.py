"""Proportional valves: Festo MPA on CPX and VTEM, over Modbus TCP."""

from drivers.valves.bank import ValveBank
from drivers.valves.config import MpaConfig, VtemConfig
from drivers.valves.pressures import Applied, BankReading

__all__ = ["Applied", "BankReading", "MpaConfig", "ValveBank", "VtemConfig"]
