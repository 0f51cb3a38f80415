"""What skills have seen and done, made up."""

from karma.contracts import Experience


def experience(*sights, held=None, handled=(), missed=(), cut=(), effects=None):
    """Things seen in this order; `held` and the others by id."""
    seen = {one.object_id: one for one in sights}
    return Experience(
        seen=seen, views={}, held=seen.get(held), handled_ids=tuple(handled),
        effects=effects or {}, missed=frozenset(missed), cut=frozenset(cut),
    )  # fmt: skip
