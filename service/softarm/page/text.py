"""Text for viser's Markdown, which renders HTML as it stands."""


def plain(text: str) -> str:
    """Write a text of others such that it is shown as it is, in Markdown, in a table, and in HTML.

    Args:
        text: Anything: names of clients, causes, messages of devices.

    Returns:
        The text with every character that could mean something as a numeric character reference.
    """
    shown = " ".join(text.split())
    return "".join(c if c.isalnum() or c in " ,;-" else f"&#{ord(c)};" for c in shown)
