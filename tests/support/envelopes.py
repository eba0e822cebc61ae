"""Reads what a page holds, as the script in it does."""

import base64
import gzip

from skhoid.lab.explore.payloads import unpack


def unpack_text(text):
    """The value of ``pack_text``."""
    return unpack(gzip.decompress(base64.b64decode(text)))
