"""Thoughts in any known tags are told from answers, and are closed where a template opens them."""

import pytest

from karma.models.llama.chat_template import prepared
from karma.models.thoughts import GAP, TAGS, split_thought

DRAFT, PROGRAM = "PickupObject(robot, 'Tomato')", "GoToObject(robot, 'Apple')\n"


@pytest.mark.parametrize("tags", TAGS)
@pytest.mark.parametrize("gap", ["", "\n", "\n\n"])
def test_a_thought_is_no_part_of_the_answer(tags, gap):
    opening, closing = tags
    for begin in (opening, f"\n{opening}\n", ""):  # the prompt may have opened it
        said = f"{begin}{DRAFT}\n{closing}{gap}{PROGRAM}"
        assert split_thought(said) == (DRAFT, PROGRAM)
    assert split_thought(f"{opening}{DRAFT}\n") == (DRAFT, "")  # never closed
    assert split_thought(PROGRAM) == ("", PROGRAM)


@pytest.mark.parametrize("tags", TAGS)
def test_a_thought_that_a_template_opens_is_closed_by_its_own_tag(tags):
    opening, closing = tags
    ended = prepared(f"assistant:{opening}\n", "off", tags)
    assert ended == f"assistant:{opening}\n\n{closing}{GAP}"
    assert prepared("assistant:", "off", tags) == "assistant:"
    assert prepared(f"assistant:{opening}\n", "on", tags) == f"assistant:{opening}\n"
    assert prepared("assistant:", "on", tags) == f"assistant:{opening}\n"
