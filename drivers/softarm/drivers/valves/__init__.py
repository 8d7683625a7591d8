"""Proportional valves: Festo MPA on CPX and VTEM, over Modbus TCP."""

from softarm.drivers.valves.bank import MpaConfig, ValveBank, VtemConfig
from softarm.drivers.valves.pressures import BankReading

__all__ = ["BankReading", "MpaConfig", "ValveBank", "VtemConfig"]
