"""How figures are written, everywhere alike: one sign for what was not measured."""

from collections.abc import Sequence

from karma.models.session import Ledger, Spent

COST_DIGITS = 6
UNKNOWN = "–"


def figure_text(value: float | None, digits: int = 2) -> str:
    """Return a figure, or the sign for what was not measured.

    >>> figure_text(None), figure_text(0.5), figure_text(3, 0)
    ('–', '0.50', '3')
    """
    return UNKNOWN if value is None else f"{value:z.{digits}f}"


def percent_text(share: float | None, digits: int = 0) -> str:
    """Return a share in per cent, without the sign of it.

    >>> percent_text(None), percent_text(0.125, 1)
    ('–', '12.5')
    """
    return figure_text(None if share is None else 100 * share, digits)


def range_text(
    value: float | None,
    low: float | None,
    high: float | None,
    digits: int = 2,
    *,
    sign: bool = False,
) -> str:
    """Return a figure with the ends of its interval, where it has one.

    >>> range_text(0.5, 0.25, 0.75, 1, sign=True), range_text(2.0, None, None)
    ('+0.5 [+0.2, +0.8]', '2.00')
    """
    if value is None:
        return UNKNOWN
    form = f"{'+' if sign else ''}z.{digits}f"
    if low is None or high is None:
        return f"{value:{form}}"
    return f"{value:{form}} [{low:{form}}, {high:{form}}]"


def plural(number: int, word: str) -> str:
    """Return a number of things.

    >>> plural(1, "task"), plural(2, "task")
    ('1 task', '2 tasks')
    """
    from karma.household.saying import plural_of  # with it numpy, which few commands need

    return f"{number} {word if number == 1 else plural_of(word)}"


def spent_text(spent: Sequence[Spent]) -> str:
    """Return what hosted models cost, a line per role and model."""
    ledger = Ledger()
    for one in spent:
        ledger.enter(one)
    return "\n".join(
        f"{one.role} {one.model}: {one.requests} requests ({one.failures} failed), "
        f"{figure_text(one.prompt_tokens, 0)} + {figure_text(one.completion_tokens, 0)} tokens, "
        f"cost {figure_text(one.cost, COST_DIGITS)}, {figure_text(one.seconds)} s"
        for one in ledger.take()
    )
