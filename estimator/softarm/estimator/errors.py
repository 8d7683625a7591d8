"""The error that wrong input raises, and advice on unknown words."""

from collections.abc import Collection, Iterable
from difflib import get_close_matches


class InputError(ValueError):
    """An error in what the user gave, described in one line.

    Args:
        where: The file and the field, column or option at fault.
        what: What is wrong, with the offending value and the limit.
        cure: What to do about it.
    """

    def __init__(self, where: str, what: str, cure: str) -> None:
        super().__init__(f"{where}: {what}; {cure}")
        self.where = where
        self.what = what
        self.cure = cure


def require_known(where: str, kind: str, name: str, names: Collection[str]) -> None:
    """Refuse a name that is not among those of its kind.

    Raises:
        InputError: It is none of them.
    """
    if name not in names:
        raise InputError(where, f"no {kind} {name!r}", f"use one of {', '.join(names) or 'none'}")


def suggest(name: str, names: Iterable[str], otherwise: str, cutoff: float = 0.5) -> str:
    """Name the known word that was probably meant, or return other advice where none is near.

    Args:
        name: What was given.
        names: What might have been meant.
        otherwise: The other advice.
        cutoff: Likeness from which a word is near, from 0 to 1 (``difflib``).
    """
    close = get_close_matches(name, list(names), n=1, cutoff=cutoff)
    return f"did you mean '{close[0]}'?" if close else otherwise
