"""Tell thoughts from answers, by the tags that families of models put around a thought.

Local and hosted models share it: what stands in a thought is never carried out.
"""

TAGS = (
    ("<think>", "</think>"),
    ("<thinking>", "</thinking>"),
    ("<thought>", "</thought>"),
    ("<reasoning>", "</reasoning>"),
    ("<seed:think>", "</seed:think>"),
    ("[THINK]", "[/THINK]"),
    ("◁think▷", "◁/think▷"),
    ("<|START_THINKING|>", "<|END_THINKING|>"),
    ("<|begin_of_thought|>", "<|end_of_thought|>"),
    ("<|channel>thought", "<channel|>"),
    ("<|channel|>analysis<|message|>", "<|channel|>final<|message|>"),
    ("Here are my reasoning steps:", "[BEGIN FINAL RESPONSE]"),
)
GAP = "\n\n"  # between thought and answer, as the families' own templates have it


def split_thought(text: str) -> tuple[str, str]:
    r"""Return the thought that a text holds, "" for none, and the answer behind it.

    The opening tag may have been in the prompt. A thought that is not closed leaves no answer.

    >>> split_thought("<think>\nAn apple.\n</think>\n\nGo")
    ('An apple.', 'Go')
    >>> split_thought("[THINK]An app")
    ('An app', '')
    """
    for opening, closing in TAGS:
        before, is_closed, answer = text.rpartition(closing)
        if is_closed:
            thought = before.partition("<|end|>")[0]
            return thought.strip().removeprefix(opening).strip(), answer.lstrip()
        if text.lstrip().startswith(opening):
            return text.lstrip().removeprefix(opening).strip(), ""
    return "", text


def open_tag(text: str) -> tuple[str, str] | None:
    """Return the tags of the thought that a text leaves open, or None."""
    return next((tags for tags in TAGS if text.rfind(tags[0]) > text.rfind(tags[1])), None)


def tags_in(template: str) -> tuple[str, str] | None:
    """Return the tags that a chat template knows, or None."""
    return next((tags for tags in TAGS if tags[1] in template), None)


def is_tag(token: str) -> bool:
    """Return whether a control token is part of a tag, and is to be read in an answer."""
    return len(token) > 1 and any(token in tag for tags in TAGS for tag in tags)
