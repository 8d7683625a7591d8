"""The steady beat of an instrument that speaks without a request."""


class Beat:
    """Times at a fixed rate, without drift; what is more than a second late is left out.

    Args:
        rate: Beats per second.
    """

    def __init__(self, rate: float) -> None:
        self.rate = rate
        self.next = 0.0

    def start(self, time: float) -> None:
        """Set the next beat to ``time`` [s]."""
        self.next = time

    def take(self, time: float) -> None:
        """Pass the beat that is due at ``time`` [s]."""
        self.next += 1.0 / self.rate
        if time - self.next > 1.0:
            self.next = time
