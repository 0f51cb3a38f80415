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
from karma.offline import go_offline


def modules() -> tuple[list[str], list[str]]:
    """Return the modules that can be imported here, and those that cannot."""
    found, left_out = ["karma"], []
    for one in pkgutil.walk_packages(karma.__path__, "karma.", onerror=lambda _: None):
        if one.name.endswith("__main__"):
            continue
        try:
            importlib.import_module(one.name)
        except ImportError as error:
            left_out.append(f"{one.name} ({error.name})")
        else:
            found.append(one.name)
    return found, left_out


def main(folder: Path) -> None:
    """Write the pages."""
    import pdoc

    warnings.simplefilter("ignore")  # types of extras that are not installed stay words
    go_offline()
    found, left_out = modules()
    pdoc.render.configure(docformat="google", search=False, show_source=False)
    pdoc.pdoc(*found, output_directory=folder)
    print(f"reference: {folder}/index.html, {len(found)} modules")
    if left_out:
        print("left out, an extra is missing: " + ", ".join(left_out))


if __name__ == "__main__":
    main(Path(sys.argv[1] if sys.argv[1:] else "build/api"))
