"""Numbers of things in messages."""


def counted(count: int, thing: str) -> str:
    """Write a number of things, such as ``1 sample`` or ``2 samples``."""
    return f"{count} {thing}{'' if count == 1 else 's'}"
