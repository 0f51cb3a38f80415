"""A brought model folder with a value that no library expects is refused by name, or opens."""

from support.abuse import all_held
from support.abuse.folders import folders


def test_model_folder_with_any_value_is_refused_by_name_or_opens(tmp_path):
    all_held(folders, 30, tmp_path)
