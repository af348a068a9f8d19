"""Numbers of things in words."""


def counted(n: int, one: str) -> str:
    """`1 manoeuvre`, `2 manoeuvres`."""
    return f"{n} {one}{'s' if n != 1 else ''}"


def pace(rate: float, left: float) -> str:
    """`3.4 a second, 2 min left`.   left: [s]."""
    fast = f"{rate:.0f}" if rate >= 100 else f"{rate:.2g}"
    long = f"{left:.0f} s"
    for unit, seconds in (("min", 60.0), ("h", 3600.0)):
        if left >= 2 * seconds:
            long = f"{left / seconds:.0f} {unit}"
    return f"{fast} a second, {long} left"
