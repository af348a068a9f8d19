from core.bounds import MOST_SIGNS, quoted


def test_a_value_is_quoted_as_its_repr():
    """A long one is shortened to its beginning and end."""
    assert quoted("F-16") == "'F-16'"
    assert quoted(["a", 1.5, None]) == "['a', 1.5, None]"
    long = quoted("begin" + "W" * 300 + "end")
    assert len(long) == MOST_SIGNS
    assert (long[:6], long[-4:]) == ("'begin", "end'")
    assert quoted(list(range(40))) == "[0, 1, 2, 3, 4, 5, ...]"
