"""Answers, names and ids that mean harm are data, in the parser, the terminal and the page."""

from support.abuse import all_held
from support.abuse.answers import answers, showing


def test_hostile_answers_are_read_as_data_or_refused_with_their_line(tmp_path):
    all_held(answers, 500, tmp_path)


def test_hostile_names_are_shown_and_steer_neither_terminal_nor_page(tmp_path):
    all_held(showing, 200, tmp_path)
