"""Material laws of the body's regions."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from softarm.estimator.arrays import Floats
from softarm.estimator.errors import InputError

HyperelasticLaw = Literal["neo_hookean", "yeoh", "gent", "softening"]
CorotationalLaw = Literal["small", "corotational", "corotational_polar", "corotational_edge_polar"]

LAW_CODES = {"neo_hookean": 0, "yeoh": 1, "gent": 2, "softening": 3}
FRAME_CODES = {"small": 0, "corotational": 1, "corotational_polar": 2, "corotational_edge_polar": 3}


@dataclass(frozen=True)
class Material:
    """One region's material.

    The hyperelastic laws share the energy psi(I) + U(J) with the first invariant I of the isochoric
    right Cauchy-Green tensor, U = kappa/4 (J^2 - 1 - 2 ln J) and, with mu the shear modulus,

    * ``neo_hookean``: psi' = mu/2
    * ``yeoh``: psi' = mu/2 (1 + 2 a (I - 3) + 3 b (I - 3)^2)
    * ``gent``: psi' = mu/2 a / (a - (I - 3)), which locks at I - 3 = a
    * ``softening``: psi' = mu/2 (a + (1 - a) exp(-b (I - 3))), from mu at rest to a mu when stretched

    The co-rotational laws, for ``tet4`` only, are linear elasticity in a frame that follows the element:
    ``corotational`` the frame of its first three nodes (SOFA's method "large"), ``corotational_polar`` the
    polar rotation of its deformation gradient, ``corotational_edge_polar`` that of its edge matrix (SOFA's
    method "polar"); ``small`` is linear elasticity.

    Args:
        law: Name of the law.
        young: Young's modulus at rest [Pa].
        poisson: Poisson's ratio at rest, in (0, 0.5).
        density: Mass per volume [kg/m3].
        shape: The two dimensionless parameters (a, b) of the law; ignored where it has none.

    Raises:
        InputError: A parameter is outside its range.
    """

    law: HyperelasticLaw | CorotationalLaw = "neo_hookean"
    young: float = 300e3
    poisson: float = 0.45
    density: float = 1070.0
    shape: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        """Check the parameters."""
        if self.law not in LAW_CODES and self.law not in FRAME_CODES:
            names = ", ".join([*LAW_CODES, *FRAME_CODES])
            raise InputError("material", f"law {self.law!r} is unknown", f"use one of {names}")
        if not self.young > 0.0:
            raise InputError("material", f"young = {self.young} Pa is not positive", "give it in pascal")
        if not 0.0 < self.poisson < 0.5:
            raise InputError(
                "material", f"poisson = {self.poisson} is outside (0, 0.5)", "use at most 0.4999"
            )
        if self.density < 0.0:
            raise InputError("material", f"density = {self.density} kg/m3 is negative", "give 0 or more")
        if self.law == "gent" and not self.shape[0] > 0.0:
            raise InputError(
                "material", f"gent limit {self.shape[0]} is not positive", "give shape = [limit, 0]"
            )

    @property
    def corotational(self) -> bool:
        """Whether the law is linear in a frame that follows the element."""
        return self.law in FRAME_CODES

    @property
    def shear_modulus(self) -> float:
        """Shear modulus at rest [Pa]."""
        return self.young / (2.0 * (1.0 + self.poisson))

    @property
    def bulk_modulus(self) -> float:
        """Bulk modulus at rest [Pa]."""
        return self.young / (3.0 * (1.0 - 2.0 * self.poisson))

    def coefficients(self) -> Floats:
        """Collect what the kernels read: law code, half shear modulus, bulk modulus, a, b; shape (5,)."""
        # A co-rotational region has a row as well, which no hyperelastic element reads.
        code = LAW_CODES.get(self.law, 0)
        return np.array([code, 0.5 * self.shear_modulus, self.bulk_modulus, *self.shape])
