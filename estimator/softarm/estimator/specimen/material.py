"""What the body is made of."""

from typing import Annotated, Literal

from pydantic import Field

from softarm.estimator.specimen.entry import Entry, Finite, NotNegative, Positive

PoissonRatio = Annotated[float, Field(gt=0.0, lt=0.5, allow_inf_nan=False)]


class Corotational(Entry):
    """Linear elasticity in the rotating frame of each element; linear tetrahedra only."""

    law: Literal["corotational"]
    """Always ``corotational``."""
    young_modulus_pa: Positive
    """Young's modulus."""
    poisson_ratio: PoissonRatio
    """Poisson's ratio, above 0 and below 0.5."""
    density_kg_m3: Positive
    """Density at rest."""

    @property
    def young(self) -> float:
        """Young's modulus at rest [Pa]."""
        return self.young_modulus_pa

    @property
    def shape(self) -> tuple[float, float]:
        """The law's two dimensionless parameters; none here."""
        return 0.0, 0.0


class Rubber(Entry):
    """What the nearly incompressible rubbers have in common."""

    shear_modulus_pa: Positive
    """Shear modulus mu at rest."""
    poisson_ratio: PoissonRatio
    """Poisson's ratio at rest, above 0 and below 0.5; sets the bulk modulus."""
    density_kg_m3: Positive
    """Density at rest."""

    @property
    def young(self) -> float:
        """Young's modulus at rest [Pa]."""
        return 2.0 * self.shear_modulus_pa * (1.0 + self.poisson_ratio)

    @property
    def shape(self) -> tuple[float, float]:
        """The law's two dimensionless parameters."""
        return 0.0, 0.0


class NeoHookean(Rubber):
    """Neo-Hookean rubber: dW/dI = mu/2, with I the first isochoric invariant."""

    law: Literal["neo_hookean"]
    """Always ``neo_hookean``."""


class Yeoh(Rubber):
    """Rubber whose stiffness changes with stretch: dW/dI = mu/2 (1 + 2 a (I - 3) + 3 b (I - 3)^2)."""

    law: Literal["yeoh"]
    """Always ``yeoh``."""
    second: Finite = 0.0
    """a, the second coefficient over the first; below zero softens with stretch."""
    third: Finite = 0.0
    """b, the third coefficient over the first; above zero stiffens at large stretch."""

    @property
    def shape(self) -> tuple[float, float]:
        """The law's two dimensionless parameters."""
        return self.second, self.third


class Gent(Rubber):
    """Rubber whose chains lock at a largest stretch: dW/dI = mu/2 a / (a - (I - 3))."""

    law: Literal["gent"]
    """Always ``gent``."""
    locking_invariant: Positive
    """a, the value of I - 3 at which the chains are fully stretched."""

    @property
    def shape(self) -> tuple[float, float]:
        """The law's two dimensionless parameters."""
        return self.locking_invariant, 0.0


class Softening(Rubber):
    """Rubber that softens with stretch: dW/dI = mu/2 (a + (1 - a) exp(-b (I - 3)))."""

    law: Literal["softening"]
    """Always ``softening``."""
    floor: Annotated[float, Field(gt=0.0, le=1.0)]
    """a, the part of the stiffness that remains when stretched."""
    rate: NotNegative
    """b, how fast the rest goes."""

    @property
    def shape(self) -> tuple[float, float]:
        """The law's two dimensionless parameters."""
        return self.floor, self.rate


Material = Annotated[Corotational | NeoHookean | Yeoh | Gent | Softening, Field(discriminator="law")]
