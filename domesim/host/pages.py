"""What pages that are written tell a browser to refuse."""

from __future__ import annotations

import base64
import hashlib


def hash_of_script(text: str) -> str:
    """Source of a Content-Security-Policy that lets one script of a page run, and no other.

    Parameters
    ----------
    text
        All that stands between ``<script>`` and ``</script>``, in lines that end as on Unix.
    """
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"
