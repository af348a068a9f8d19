"""Names and sentences from files of unknown origin, made fit to be shown and stored."""


def printable(text: str, most: int) -> str:
    """Text on one line of up to `most` signs; what cannot be shown becomes a blank or "?"."""
    if not text.isprintable():
        text = "".join(
            sign if sign.isprintable() else " " if sign.isspace() else "?" for sign in text
        )
    text = text.strip()
    return text if len(text) <= most else f"{text[: most - 3]}..."
