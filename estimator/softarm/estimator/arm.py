"""The finite-element model of a specimen."""

from collections.abc import Sequence

import numpy as np

from softarm.estimator.fem import FiniteElementModel, Material, Membrane, SectionNodes, Springs
from softarm.estimator.fem.parity.rings import wall_rings
from softarm.estimator.geometry import Resolution, build_mesh
from softarm.estimator.geometry.checks import element_volumes
from softarm.estimator.mesh import Mesh
from softarm.estimator.model import Load, loads_along
from softarm.estimator.rotations import from_quaternions
from softarm.estimator.specimen import Section, Specimen


def default_loads(specimen: Specimen, sections: Sequence[str] = ()) -> tuple[Load, ...]:
    """Return two lateral forces, along x and y of the base frame, at rigid sections that are not held.

    Args:
        specimen: The robot.
        sections: Names of the sections; all when left out.
    """
    return tuple(
        load
        for section in specimen.sections
        if section.frame_origin_m[2] > specimen.clamp.up_to_m and (not sections or section.name in sections)
        for load in loads_along(section.name, "xy", section=section.name)
    )


def build_arm(
    specimen: Specimen, loads: Sequence[Load] | None = None, resolution: Resolution | None = None
) -> FiniteElementModel:
    """Build the finite-element model of a specimen, with its calibrated stiffness.

    Gains and biases of pressures and the alignment of sensors are no part of it: they belong to the maps from
    recorded to model pressures and from frames to readings.

    Args:
        specimen: Description.
        loads: Loads whose amplitudes are inputs; ``default_loads`` when left out.
        resolution: Divisions of a parametric body; those of its kind when left out.

    Returns:
        The model; its sections, chambers and regions carry the specimen's names.

    Raises:
        InputError: The specimen cannot be meshed, or a load does not fit it.
    """
    return model_on_mesh(specimen, build_mesh(specimen, resolution), loads)


def model_on_mesh(specimen: Specimen, mesh: Mesh, loads: Sequence[Load] | None = None) -> FiniteElementModel:
    """Build the model of a specimen on a mesh of its body, as ``build_arm`` does on its own."""
    model = FiniteElementModel.build(
        mesh,
        region_materials(specimen, mesh),
        chambers=[f"chamber_{chamber.index}" for chamber in specimen.chambers],
        fibres=fibres(specimen, mesh),
        sections=[_section(section) for section in specimen.sections],
        loads=default_loads(specimen) if loads is None else loads,
    )
    calibration = specimen.calibration
    scales = {region: calibration.scale(region) for region in mesh.regions}
    # What is no region is a winding; all windings share one factor.
    others = [name for name in model.parameters if name not in scales]
    return model.with_scales(scales | dict.fromkeys(others, calibration.fibre_scale.value))


def region_materials(specimen: Specimen, mesh: Mesh) -> dict[str, Material]:
    """Return the material of each region; a weighed part gets the density that makes up its mass."""
    volumes = np.zeros(len(mesh.regions))
    for block in mesh.blocks:
        np.add.at(volumes, block.region, element_volumes(mesh.points, block))
    materials = {}
    for part, volume in zip(specimen.parts, volumes, strict=True):
        # Only faces have no material, and they are no parts; the specimen was checked when it was read.
        entry = specimen.materials[part.material or ""]
        # A weighed mass includes what is cast in, so it takes the place of the silicone's density.
        density = entry.density_kg_m3 if part.mass_kg is None else part.mass_kg / float(volume)
        materials[part.name] = Material(entry.law, entry.young, entry.poisson_ratio, density, entry.shape)
    return materials


def fibres(specimen: Specimen, mesh: Mesh) -> tuple[Membrane | Springs, ...]:
    """Return the winding of the chambers."""
    winding = specimen.fibres
    match winding.kind:
        case "membrane":
            return tuple(
                Membrane(f"chamber_{chamber.index}", winding.membrane_stiffness_n_m)
                for chamber in specimen.chambers
            )
        case "springs":
            return tuple(
                Springs(
                    f"chamber_{chamber.index}",
                    *wall_rings(
                        mesh.points,
                        mesh.surfaces[f"chamber_{chamber.index}"],
                        (chamber.from_m, chamber.to_m),
                        winding.rings_per_chamber,
                        winding.bars_per_ring,
                    ),
                    winding.spring_stiffness_n_m,
                )
                for chamber in specimen.chambers
            )
        case "none":
            return ()


def _section(entry: Section) -> SectionNodes:
    rotation = from_quaternions(np.array([entry.frame_quaternion]))[0]
    rows = tuple(tuple(float(value) for value in row) for row in rotation)
    return SectionNodes(entry.name, entry.frame_origin_m, rows)  # type: ignore[arg-type]
