"""Why an answer is not whole, in words that a planner is told when it is asked again."""


def cut_off(tokens: int | None) -> str:
    """Return what is said of an answer that a limit has cut; None: nobody counted its tokens."""
    many = "" if tokens is None else f" after {tokens} tokens"
    return f"the answer was cut off{many}: it must be shorter"
