"""Key expressions of one arm."""

from dataclasses import dataclass

from softarm_client.errors import SetupError

PREFIX = "softarm/@v1"
"""The leading ``@`` makes the version chunk verbatim: ``**`` never crosses API versions."""


@dataclass(frozen=True)
class ArmKeys:
    """Keys of one arm.

    Args:
        arm: The arm's name.

    Raises:
        SetupError: The name cannot be part of a key.
    """

    arm: str

    def __post_init__(self) -> None:
        if not self.arm or set(self.arm) & set("/*$#?@ "):
            raise SetupError(
                "arm", f"{self.arm!r} cannot be the name of an arm", "use letters, digits, - and _"
            )

    @property
    def base(self) -> str:
        """The common beginning."""
        return f"{PREFIX}/{self.arm}"

    def stream(self, name: str) -> str:
        """Key of a stream: ``state``, ``estimate``, ``mismatch``, ``event`` or ``shape``."""
        return f"{self.base}/{name}"

    def query(self, name: str) -> str:
        """Key of a slow value asked for: ``config``, ``specimen``, ``surface`` or ``schema``."""
        return f"{self.base}/{name}"

    def command(self, verb: str) -> str:
        """Key of a command."""
        return f"{self.base}/command/{verb}"

    @property
    def alive(self) -> str:
        """Key of the liveliness token."""
        return f"{self.base}/alive"
