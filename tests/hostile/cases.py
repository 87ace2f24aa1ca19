"""What a hostile file is: its bytes, who reads it, and what must be said about it."""

from dataclasses import dataclass

MARKER = "EXECUTED"
COMMAND = f"touch {MARKER}"


@dataclass
class Case:
    """`error` names the variants of the typed error from the outside in, `says` what else its message must contain. With
    no error the file is harmless to this program and must be read. `live` files do run something when Python reads them."""

    attack: str
    reader: str
    content: bytes
    error: str | None
    says: tuple = ()
    live: bool = False


def cases(reader, rows, live=False):
    """Rows of attack, content, error and anything that the message must contain."""
    return [Case(attack, reader, content, error, tuple(says), live) for attack, content, error, *says in rows]
