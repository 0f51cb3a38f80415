"""Names in files that become paths stay in their folder, or are refused."""

from support.abuse import all_held
from support.abuse.names import names


def test_name_of_any_pieces_never_leaves_the_folder_that_it_is_for(tmp_path):
    all_held(names, 200, tmp_path)
