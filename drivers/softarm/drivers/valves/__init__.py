"""Proportional valves: Festo MPA on CPX and VTEM, over Modbus TCP."""

from softarm.drivers.valves.bank import ValveBank
from softarm.drivers.valves.config import MpaConfig, VtemConfig
from softarm.drivers.valves.pressures import BankReading

__all__ = ["BankReading", "MpaConfig", "ValveBank", "VtemConfig"]
