"""Write the API reference from the docstrings: an HTML page per module, nothing fetched.

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
    """Return each module with the package that its import lacks, or ""."""
    found = {"karma": ""}
    for module in pkgutil.walk_packages(karma.__path__, "karma.", onerror=lambda _: None):
        try:
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)
                found[module.name] = ""
        except ImportError as error:
            found[module.name] = f"{module.name} ({error.name})"
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
