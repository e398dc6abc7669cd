"""Where numba keeps compiled kernels: a folder for each state of the sources.

Numba looks at the file of a kernel alone, and would go on using one whose callee in another file has changed.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
from pathlib import Path

_IMPORT = re.compile(r"^from (agent\.[\w.]+) import", re.M)


def use_own_cache() -> None:
    """Point numba to a cache that fits these sources; before numba is imported, and only where nobody else did."""
    here = Path(__file__).parent
    if "NUMBA_CACHE_DIR" in os.environ or not os.access(here, os.W_OK):
        return
    cache = here / "__pycache__" / f"kernels-{_digest(here)}"
    if not cache.is_dir():
        for stale in cache.parent.glob("kernels-*"):
            shutil.rmtree(stale, ignore_errors=True)
        cache.mkdir(parents=True, exist_ok=True)
    os.environ["NUMBA_CACHE_DIR"] = str(cache)


def _digest(here: Path) -> str:
    """Hash of the files that hold kernels and of all that these import from the agent."""
    texts = {file: file.read_text(encoding="utf-8") for file in sorted(here.rglob("*.py"))}
    waiting = [file for file, text in texts.items() if "@kernel" in text]
    met = set(waiting)
    while waiting:
        for module in _IMPORT.findall(texts[waiting.pop()]):
            file = here.parent.joinpath(*module.split(".")).with_suffix(".py")
            if file in texts and file not in met:
                met.add(file)
                waiting.append(file)
    digest = hashlib.sha256()
    for file in sorted(met):
        digest.update(texts[file].encode())
    return digest.hexdigest()[:16]
