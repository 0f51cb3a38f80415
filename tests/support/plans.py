"""Plans in JSON that a spec admits, and some that it does not."""

import json

from karma.plugins.alfred.suites.plan_spec import PlanSpec

ACTIONS = ("find a Apple", "find a Fridge", *(f"open the Drawer_{n}" for n in range(2, 14)))
PLANS = PlanSpec(
    texts=("why", "words"), plan="plan", number="id", name="action", actions=ACTIONS,
    max_text=12, max_actions=3,
)  # fmt: skip
NAMED = {"why": "", "words": ""}


def plan(*numbers, **texts):
    actions = [{"id": n, "action": ACTIONS[n] if 0 <= n < len(ACTIONS) else "x"} for n in numbers]
    return json.dumps({**NAMED, **texts, "plan": actions}, separators=(",", ":"))


LEGAL = (
    plan(), plan(0), plan(13, 0, 0), plan(1, why="because, so"), plan(2, words="a{b}[c]:,~ !"),
)  # fmt: skip
ILLEGAL = (
    "", "{}", plan(14), plan(-1), plan(0, 0, 0, 0), plan(0, why="thirteen char"), plan(0)[:-1],
    plan(0) + "\n", plan(0).replace("Apple", "Fridge"), plan(0, why='a"b'), plan(0, why="é"),
    plan(0).replace(":0", ":00"), json.dumps({"plan": [], **NAMED}),
)  # fmt: skip
