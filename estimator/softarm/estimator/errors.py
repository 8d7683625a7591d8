"""The error a caller's error raises."""


class InputError(ValueError):
    """An error in what the user gave, told in one line.

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
