"""Names in files that become paths stay in their folder, or are refused."""

from functools import partial

from support.abuse import all_held
from support.abuse.names import names

from karma.errors import FileError
from karma.files import below
from karma.journal.steps import steps_path


def _of_a_file(name, folder):
    try:
        path = below(folder, name)
    except FileError as error:
        assert len(str(error)) < 1000
        return
    path.write_text("x")
    assert path.parent == folder


def _of_steps(name, folder):
    path = steps_path(folder, name, name, 0)
    path.parent.mkdir(parents=True)
    path.write_text("x")
    assert path.resolve().is_relative_to(folder.resolve())
    assert steps_path(folder, name + "?", name, 0) != path


def test_name_of_any_pieces_never_leaves_the_folder_that_it_is_for(tmp_path):
    all_held(partial(names, ways=(_of_a_file, _of_steps)), 100, tmp_path)
