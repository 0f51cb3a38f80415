"""What n units could at best have known: the greedy bound against every choice there is."""

from itertools import combinations

from hypothesis import given, settings
from hypothesis import strategies as st

from karma.plugins.homes.lived.table import most_known

WAITS = st.lists(
    st.tuples(st.integers(0, 8), st.integers(1, 8)).map(lambda one: (one[0], one[0] + one[1])),
    max_size=8,
)


def fits(chosen, units):
    """Return whether so many units hold some waits: at no time are more of them held."""
    return all(
        sum(start <= time < end for start, end in chosen) <= units
        for time in {start for start, _ in chosen}
    )


def by_all_choices(waits, units):
    return next(
        size
        for size in range(len(waits), -1, -1)
        if any(fits(chosen, units) for chosen in combinations(waits, size))
    )


@settings(max_examples=300, deadline=None)
@given(WAITS, st.integers(1, 4))
def test_the_bound_is_what_the_best_choice_gives(waits, units):
    assert most_known(waits, units) == by_all_choices(waits, units)
