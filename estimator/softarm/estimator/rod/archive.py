"""Fitted rods as files, and the key by which one belongs to a specimen."""

import hashlib
import json
import zipfile
from dataclasses import asdict
from importlib import resources
from io import BytesIO
from typing import Any

import numpy as np

from softarm.estimator.errors import InputError
from softarm.estimator.geometry import DEFAULTS
from softarm.estimator.rod.arrays import Laws
from softarm.estimator.rod.chain import Chain
from softarm.estimator.rod.fit import FittedRod, Recipe
from softarm.estimator.rod.held_out import HeldOut, HeldOutReport
from softarm.estimator.rod.laws import OUTPUTS
from softarm.estimator.rod.model import CalibratedRod
from softarm.estimator.specimen import MeshFile, Specimen

FORMAT = "softarm.rod/1"
MODEL_VERSION = 4
"""Raised whenever the elements or the link laws change what a fit gives."""
# The outputs of a law that count; the others pad it (`laws.OUTPUTS`).
STRAINS = 6
CHAIN_ARRAYS = (
    "heights",
    "section_station",
    "section_offset",
    "section_rotation",
    "chambers",
    "mass",
    "mass_centre",
    "mass_weights",
)


def shape_key(specimen: Specimen, recipe: Recipe | None = None) -> str:
    """Hash all that shapes the finite-element answer and the fit.

    That is geometry with its mesh and resolution, materials, masses, chambers, fibres, clamp and the recipe;
    not sensors, section frames, gravity or calibrated values.

    Raises:
        InputError: The mesh file of the specimen cannot be read.
    """
    geometry = specimen.geometry
    frames = {"frame_origin_m", "frame_quaternion"}
    content = {
        "format": FORMAT,
        "model": MODEL_VERSION,
        "geometry": geometry.model_dump(mode="json"),
        "mesh": _mesh_hash(specimen, geometry) if isinstance(geometry, MeshFile) else None,
        "resolution": asdict(DEFAULTS[geometry.kind]),
        "materials": {name: entry.model_dump(mode="json") for name, entry in specimen.materials.items()},
        "segments": [part.model_dump(mode="json") for part in specimen.segments],
        "sections": [part.model_dump(mode="json", exclude=frames) for part in specimen.sections],
        "chambers": [chamber.model_dump(mode="json") for chamber in specimen.chambers],
        "fibres": specimen.fibres.model_dump(mode="json"),
        "clamp": specimen.clamp.model_dump(mode="json"),
        "recipe": asdict(recipe or Recipe()),
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _mesh_hash(specimen: Specimen, geometry: MeshFile) -> str:
    path = specimen.folder / geometry.path
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(str(path), f"cannot read the mesh: {error.strerror}", "check its path") from None


def to_bytes(fitted: FittedRod, key: str, name: str) -> bytes:
    """Write a rod as a compressed npz, with its key and the name of its specimen."""
    rod = fitted.rod
    header = {
        "format": FORMAT,
        "key": key,
        "specimen": name,
        "sections": rod.chain.sections,
        "regions": rod.chain.regions,
        "chamber_count": rod.chain.chamber_count,
        "samples": fitted.samples,
        "symmetries": fitted.symmetries,
        "report": asdict(fitted.report),
    }
    arrays: dict[str, Any] = {name: getattr(rod.chain, name) for name in CHAIN_ARRAYS}
    buffer = BytesIO()
    np.savez_compressed(
        buffer,
        header=np.array(json.dumps(header)),
        # Rods are shipped with the package: indices fit a byte, and the padding of the outputs is left out.
        table=rod.laws.table.astype(np.int8),
        coefficients=rod.laws.coefficients[..., :STRAINS],
        scale=rod.laws.scale,
        reach=rod.laws.reach,
        **arrays,
    )
    return buffer.getvalue()


def from_bytes(data: bytes) -> tuple[FittedRod, str] | None:
    """Read a rod and its key, with unit stiffness factors and no loads; None where the data hold none."""
    try:
        with np.load(BytesIO(data), allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
        header = json.loads(str(arrays["header"]))
        if header["format"] != FORMAT:
            return None
        return _assemble(header, arrays), str(header["key"])
    # A file in a cache may be cut off or of another version; the rod is then fitted anew.
    except (ValueError, KeyError, TypeError, OSError, EOFError, zipfile.BadZipFile):
        return None


def _assemble(header: dict[str, Any], arrays: dict[str, Any]) -> FittedRod:
    chain = Chain(
        sections=tuple(header["sections"]),
        regions=tuple(header["regions"]),
        chamber_count=int(header["chamber_count"]),
        **{name: arrays[name] for name in CHAIN_ARRAYS},
    )
    coefficients = np.zeros((*arrays["coefficients"].shape[:2], OUTPUTS))
    coefficients[..., :STRAINS] = arrays["coefficients"]
    table, scale, reach = arrays["table"].astype(np.int64), arrays["scale"], arrays["reach"]
    laws = Laws(table, coefficients, chain.chambers, scale, reach, np.ones(chain.links))
    parts = {
        name: HeldOut(**{**part, "force_range": tuple(part["force_range"])})
        for name, part in header["report"].items()
    }
    rod = CalibratedRod(chain, laws, ())
    return FittedRod(rod, HeldOutReport(**parts), int(header["samples"]), int(header["symmetries"]))


def shipped_rod(key: str) -> FittedRod | None:
    """Load the shipped rod with a key, None where there is none."""
    folder = resources.files("softarm.estimator.rod") / "shipped"
    if not folder.is_dir():
        return None
    for file in folder.iterdir():
        fitted = from_bytes(file.read_bytes()) if file.name.endswith(".npz") else None
        if fitted is not None and fitted[1] == key:
            return fitted[0]
    return None
