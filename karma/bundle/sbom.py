"""Write the software bill of materials: CycloneDX 1.5, the same bytes for the same things."""

import uuid
from collections.abc import Mapping, Sequence
from typing import Any
from urllib.parse import quote

from packaging.utils import canonicalize_name

from karma.bundle.wheels import Wheel
from karma.files import to_json
from karma.infer.manifest.manifest import ModelEntry


def sbom(wheels: Sequence[Wheel], hashes: Mapping[str, str], models: Sequence[ModelEntry]) -> bytes:
    """Return the bill as JSON: no time, an identity that follows from the content, sorted.

    Args:
        wheels: all packages, ours among them.
        hashes: SHA-256 by the wheel's file name.
        models: those that the bundle carries.
    """
    ours = next(one for one in wheels if one.name == "karma-offline")
    packages = [_package(one, hashes[one.path.name]) for one in wheels if one is not ours]
    parts = sorted([*packages, *map(_model, models)], key=lambda part: str(part["bom-ref"]))
    names = {one.name: _purl(one) for one in wheels}
    links = [
        {
            "ref": _purl(one),
            "dependsOn": sorted(
                {names[n] for n in (canonicalize_name(r.name) for r in one.needs) if n in names}
            ),
        }
        for one in wheels
    ]
    root = {**_package(ours, hashes[ours.path.name]), "type": "application"}
    body = {
        "bomFormat": "CycloneDX",
        "specVersion": "1.5",
        "version": 1,
        "metadata": {"component": root},
        "components": parts,
        "dependencies": sorted(links, key=lambda link: str(link["ref"])),
    }
    identity = uuid.uuid5(uuid.NAMESPACE_OID, to_json(body).decode())
    return to_json({**body, "serialNumber": f"urn:uuid:{identity}"}, indent=1)


def _purl(wheel: Wheel) -> str:
    return f"pkg:pypi/{wheel.name}@{quote(wheel.version, safe='')}"


def _package(wheel: Wheel, sha256: str) -> dict[str, Any]:
    return {
        "type": "library",
        "bom-ref": _purl(wheel),
        "purl": _purl(wheel),
        "name": wheel.name,
        "version": wheel.version,
        "hashes": [{"alg": "SHA-256", "content": sha256}],
        "licenses": [{"license": {"name": wheel.licence}}],
    }


def _model(entry: ModelEntry) -> dict[str, Any]:
    files = [
        {
            "type": "file",
            "bom-ref": f"model:{entry.name}/{file.path}",
            "name": file.path,
            "hashes": [{"alg": "SHA-256", "content": file.sha256}],
        }
        for file in entry.files
    ]
    return {
        "type": "machine-learning-model",
        "bom-ref": f"model:{entry.name}",
        "name": entry.name,
        "version": entry.revision or "",
        "licenses": [{"license": {"name": entry.licence}}],
        "description": f"{entry.role}, {entry.format}; {entry.source}",
        "components": files,
    }
