"""The base of every table of a specimen file, and the kinds of value it holds."""

import math
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Finite = Annotated[float, Field(allow_inf_nan=False)]
Angle = Annotated[float, Field(ge=-math.tau, le=math.tau, allow_inf_nan=False)]
"""In radians: a value beyond a full circle was meant in degrees."""
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Vector = tuple[Finite, Finite, Finite]
Quaternion = tuple[Finite, Finite, Finite, Finite]
NAME = r"^[A-Za-z][A-Za-z0-9_]*$"
Name = Annotated[str, Field(min_length=1, pattern=NAME)]


class Entry(BaseModel):
    """A table of the file: immutable, and closed to unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)


class Value(Entry):
    """A fitted number and its uncertainty."""

    value: Finite
    """Best value, in the unit that the key's name carries."""
    std: NotNegative = 0.0
    """Standard deviation, in the same unit; 0 when unknown."""
