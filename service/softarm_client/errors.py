"""The errors of a client: each is one line that names what failed and what to do."""

from softarm_client.commands import Refused


class ClientError(Exception):
    """Base of the errors of this package."""


class SessionError(ClientError):
    """A session that cannot be opened.

    Args:
        where: Argument or file at fault.
        what: What is wrong, with the offending value.
        cure: What to do about it.
    """

    def __init__(self, where: str, what: str, cure: str) -> None:
        super().__init__(f"{where}: {what}; {cure}")
        self.where = where
        self.what = what
        self.cure = cure


class SetupError(SessionError):
    """It cannot be opened as it is configured."""


class UnreachableError(SessionError):
    """An address is taken or not there yet, or nothing answers at it: a later try may succeed."""


class CommandRefusedError(ClientError):
    """The service refused a command, or did not answer.

    Args:
        refusal: Code, message and hint.
    """

    def __init__(self, refusal: Refused) -> None:
        super().__init__(f"{refusal.verb}: {refusal.message}; {refusal.hint}")
        self.refusal = refusal


class ServiceSilentError(ClientError, TimeoutError):
    """The service published nothing on a stream for longer than the stated time."""
