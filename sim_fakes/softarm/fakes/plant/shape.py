"""Whether a specimen has the shape of SoPrA, whose fake has constants fitted to its recordings."""

from softarm.estimator.specimen import Specimen, load_specimen


def has_shape_of_sopra(specimen: Specimen) -> bool:
    """Return whether geometry, parts and chambers are those of the shipped specimen ``sopra``."""
    return _shape(specimen) == _shape(load_specimen("sopra"))


def _shape(specimen: Specimen) -> tuple[object, ...]:
    parts = [(part.name, part.from_m, part.to_m) for part in specimen.named_parts]
    chambers = [(c.segment, c.from_m, c.to_m, round(c.azimuth_rad, 6)) for c in specimen.chambers]
    return specimen.geometry, parts, chambers
