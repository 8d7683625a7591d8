"""The page before the arm's service is there: it waits, and shows for what."""

from collections.abc import Callable
from dataclasses import dataclass

import viser

from softarm.estimator.specimen import Specimen
from softarm.page.text import plain
from softarm_client import Arm
from softarm_client.errors import ClientError, SetupError
from softarm_client.messages import Surface


@dataclass(frozen=True)
class ServedArm:
    """An arm whose service answers.

    Args:
        client: Client of the service.
        surface: The arm's surface at rest.
        specimen: The arm.
    """

    client: Arm
    surface: Surface
    specimen: Specimen


def ask_arm(client: Arm) -> ServedArm:
    """Request from a service what the page shows.

    Raises:
        CommandRefusedError: No service of this arm answers.
    """
    specimen = Specimen.model_validate_json(client.ask("specimen"), extra="ignore")  # of a newer service
    return ServedArm(client, client.surface(), specimen)


def wait_for_arm(
    server: viser.ViserServer,
    connect: Callable[[], Arm],
    notify: Callable[[str], None],
    ended: Callable[[], bool],
) -> ServedArm | None:
    """Wait until the arm's service answers; browsers show meanwhile that the page waits.

    Args:
        server: viser's server.
        connect: Opens the client; raises ``UnreachableError`` while nothing answers.
        notify: Called with what the page waits for, once for each reason.
        ended: Pauses before the next try, and returns whether to end instead.

    Returns:
        The arm, or ``None`` where the wait was ended.

    Raises:
        SetupError: No client can be opened as it is configured, however long the page waits.
    """
    shown = server.gui.add_markdown("")
    client, last = None, ""
    while True:
        try:
            client = client or connect()
            arm = ask_arm(client)
        except SetupError:
            raise
        except ClientError as error:
            text = f"waiting for the service: {error}"
            if text != last:
                last, shown.content = text, f"## {plain(text)}"
                notify(text)
        else:
            shown.remove()
            return arm
        if ended():
            if client is not None:
                client.close()
            return None
