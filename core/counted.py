"""Numbers of things in words."""


def counted(n: int, one: str, several: str = "") -> str:
    """`1 manoeuvre`, `2 manoeuvres`; several: the plural, where it has no s."""
    return f"{n} {one if n == 1 else several or f'{one}s'}"
