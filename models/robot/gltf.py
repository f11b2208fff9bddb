"""What a glTF names besides itself: Drake puts the content of those files into recordings."""

import json
from pathlib import Path
from urllib.parse import unquote

_MAX_BYTES = 1 << 28  # bytes
_PICTURES = (".png", ".jpg", ".jpeg", ".ktx2")


def gltf_fault(path: Path) -> str:
    """The reason why a glTF must not be drawn, in a few words; '' if it may.

    Its buffers must be .bin files and its images pictures, in its folder or below, by a path
    without a link that leads out. A page with the drawn robot is passed on to others: it must not
    carry any other file of this machine.
    """
    try:
        if path.stat().st_size > _MAX_BYTES:
            return ".gltf, too large"
        content = json.loads(path.read_text(encoding="utf-8"))
        uris = [
            (str(item["uri"]), kinds)
            for key, kinds in (("buffers", (".bin",)), ("images", _PICTURES))
            for item in content.get(key, [])
            if "uri" in item
        ]
        folder = path.resolve().parent
        for uri, kinds in uris:
            if uri.startswith("data:"):
                continue
            target = (folder / unquote(uri)).resolve()
            if not target.is_relative_to(folder) or target.suffix.lower() not in kinds:
                return ".gltf, names a file that is none of its own"
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return ".gltf, not readable"
    return ""
