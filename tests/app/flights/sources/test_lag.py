"""The lag of a source against its definition: the newest age less the least of a minute."""

from hypothesis import given, settings
from hypothesis import strategies as st

from app.flights.sources.lag import LAG_OVER, LAG_PARTS, Lag
from tests.support.repetition import examples

PART = LAG_OVER / LAG_PARTS
STEPS = st.lists(st.tuples(st.floats(0.0, 2.0 * PART), st.floats(0.0, 5.0)), max_size=40)


@settings(max_examples=examples(100), deadline=None)
@given(STEPS)
def test_the_lag_is_over_the_least_age_of_the_last_parts_that_had_a_sample(
    steps: list[tuple[float, float]],
) -> None:
    lag, arrived, least = Lag(1.0), 0.0, dict[int, float]()
    for step, age in steps:
        arrived += step
        t = arrived - age
        lag.note(arrived, t)
        part, age = int(arrived / PART), arrived - t
        least[part] = min(age, least.get(part, age))
        assert lag.now == arrived - (t + min([*least.values()][-LAG_PARTS:]))
