"""The sentences and verbs of requests, read from `forms.toml`."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path

import msgspec

from karma.files import read_toml

FORMS = Path(__file__).with_name("forms.toml")


class _Forms(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    forms: tuple[str, ...]


class RequestForms(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All of `forms.toml`."""

    place: _Forms
    errand: _Forms
    place_then: _Forms
    time: _Forms
    who: _Forms
    count: _Forms
    did: Mapping[str, tuple[str, ...]]  # action -> verbs, past
    do: Mapping[str, tuple[str, ...]]  # action -> verbs, after "did"


@cache
def request_forms() -> RequestForms:
    """Return the table, read once."""
    return read_toml(FORMS, RequestForms)
