"""The message definitions of ROS 2, with classes that fill in what is left out, as those of rclpy do."""

from dataclasses import dataclass
from functools import cache

import numpy as np
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.base import Nodetype

DISTRIBUTIONS = [Stores.ROS2_HUMBLE, Stores.ROS2_JAZZY, Stores.ROS2_KILTED, Stores.ROS2_LYRICAL]
ZEROS = {"string": "", "bool": False}
read = cache(get_typestore)


class Typestore:
    """Finds message classes by name, as the node does in an installation; turns messages to CDR and back."""

    def __init__(self, distribution):
        self.store = read(distribution)

    def __call__(self, name):
        return MessageClass(self.store, name)

    def through_cdr(self, outgoing):
        """Write a message as CDR and read it back."""
        raw = self.store.serialize_cdr(outgoing.message, outgoing.type)
        return self.store.deserialize_cdr(raw, outgoing.type)


@dataclass
class MessageClass:
    """A class of one distribution: constants, and a constructor with keywords that may be left out."""

    store: object
    name: str

    def __getattr__(self, constant):
        return getattr(self.store.types[self.name], constant)

    def __call__(self, **fields):
        _, definitions = self.store.fielddefs[self.name]
        assert set(fields) <= {name for name, _ in definitions}, self.name
        filled = {name: self._filled(kind, fields.get(name)) for name, kind in definitions}
        return self.store.types[self.name](**filled)

    def _filled(self, kind, value):
        node, inner = kind
        if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            (element, what), size = inner
            given = [] if value is None else value
            assert not size or len(given) == size
            return (
                np.array(given, what[0]) if element == Nodetype.BASE and what[0] != "string" else list(given)
            )
        if value is not None:
            return value
        return MessageClass(self.store, inner)() if node == Nodetype.NAME else ZEROS.get(inner[0], 0)
