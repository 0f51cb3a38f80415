"""Write the API reference from the docstrings: one HTML page a module, nothing fetched.

    python scripts/make_reference.py FOLDER

Modules of extras that are not installed are left out, and named.
"""

import importlib
import pkgutil
import sys
import warnings
from pathlib import Path

import karma
from karma.offline.guard import go_offline


def modules() -> dict[str, str]:
    """Return each module, with what is missing to import it here, "" where nothing is."""
    found = {"karma": ""}
    for one in pkgutil.walk_packages(karma.__path__, "karma.", onerror=lambda _: None):
        try:
            if not one.name.endswith("__main__"):
                importlib.import_module(one.name)
                found[one.name] = ""
        except ImportError as error:
            found[one.name] = f"{one.name} ({error.name})"
    return found


if __name__ == "__main__":
    import pdoc

    warnings.simplefilter("ignore")  # types of extras that are not installed stay words
    go_offline()
    folder, found = Path([*sys.argv, "build/api"][1]), modules()
    pdoc.render.configure(docformat="google", search=False, show_source=False)
    pdoc.pdoc(*(name for name, missing in found.items() if not missing), output_directory=folder)
    print(f"reference: {folder}/index.html, {len(found)} modules; left out, an extra is missing:")
    print(*filter(None, found.values()), sep="\n")
