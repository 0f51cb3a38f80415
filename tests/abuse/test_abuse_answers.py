"""Answers, names and ids that mean harm are data, in the parser, the terminal and the page."""

import pytest
from support.abuse import all_held
from support.abuse.answers import answers, showing

from karma.agent.planning.program import parse_program
from karma.errors import ProgramError


def test_hostile_answers_are_read_as_data_or_refused_with_their_line(tmp_path):
    all_held(answers, 500, tmp_path)


def test_hostile_names_are_shown_and_steer_neither_terminal_nor_page(tmp_path):
    all_held(showing, 200, tmp_path)


def test_position_with_a_number_beyond_floats_is_refused():
    with pytest.raises(ProgramError, match="within 1000 metres"):
        parse_program(f"Explore(robot, 'Apple', [(0, {10**400}, 0)])")
