"""What a test needs of this machine, and is skipped without."""

import shutil
import subprocess

import pytest

from karma.errors import KarmaError
from karma.models.manifest import find_model, verify

CUT_OFF = ("unshare", "--user", "--map-root-user", "--net")


def need_models(*names):
    """Skip unless these models of the manifest are here and right."""
    try:
        for name in names:
            verify(find_model(name))
    except KarmaError as error:
        pytest.skip(f"needs the shipped models: {str(error).splitlines()[0]}")


def need_namespace(*setting_up):
    """Return what to put before a command that shall see no network; skip where that is forbidden.

    `setting_up`: words of a command that is tried in it, by default one that does nothing.
    """
    if shutil.which("unshare") is None:
        pytest.skip("needs unshare")
    command = [*CUT_OFF, *(setting_up or ("true",))]
    trial = subprocess.run(command, capture_output=True, check=False)
    if trial.returncode != 0:
        pytest.skip(f"namespaces are not permitted here: {trial.stderr.decode().strip()}")
    return CUT_OFF
