"""Bags of scenarios that lie elsewhere: fetched once, from any URL that fsspec reads, and kept.

Scenarios name such bags by `${AMAZE_DATA}/...`; what stands behind that name is looked up below the URL. A bag whose
SHA-256 the scenario says is fetched again when what was kept is another one.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Iterator

from ..errors import ReplayError
from ..scenario import Case, load_cases
from .task import Task

__all__ = ["VARIABLE", "data_folder", "fetch_bags", "kept_in"]

VARIABLE = "AMAZE_DATA"
_BLOCK = 1 << 20


def kept_in(url: str) -> Path:
    """Return the folder in which bags of a URL are kept."""
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return home / "amaze-replay" / hashlib.sha256(url.encode()).hexdigest()[:16]


@contextmanager
def data_folder(url: str) -> Iterator[None]:
    """Let scenarios find bags of a URL where they are kept; empty: leave all as it is."""
    if not url:
        yield
        return
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = str(kept_in(url))
    try:
        yield
    finally:
        if before is None:
            del os.environ[VARIABLE]
        else:
            os.environ[VARIABLE] = before


def fetch_bags(task: Task, url: str) -> None:
    """Fetch the bags of a task that are not here yet; call it within `data_folder`.

    Raises:
        ReplayError: one cannot be fetched.
        ConfigError: the scenario has a mistake.
    """
    cases = [] if task.error else load_cases(Path(task.path))
    for case in cases:
        if case.variant == task.variant:
            _fetch_bags(case, url)


def _fetch_bags(case: Case, url: str) -> None:
    folder = kept_in(url)
    for bag in case.bags:
        if folder in bag.path.parents and not _is_kept(bag.path, bag.sha256):
            _fetch(f"{url.rstrip('/')}/{bag.path.relative_to(folder).as_posix()}", bag.path)


def _is_kept(path: Path, sha256: str) -> bool:
    return path.is_file() and (not sha256 or _sha256(path) == sha256)


def _sha256(path: Path) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as file:
        for block in iter(lambda: file.read(_BLOCK), b""):
            digest.update(block)
    return digest.hexdigest()


def _fetch(url: str, path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with _opened(url) as source, part.open("wb") as target:
            shutil.copyfileobj(source, target, _BLOCK)
            target.flush()
            os.fsync(target.fileno())
        part.replace(path)
    except Exception as error:
        part.unlink(missing_ok=True)
        if isinstance(error, ReplayError):
            raise
        words = " ".join(str(error).split()) or type(error).__name__
        raise ReplayError(f"{url}: cannot be fetched ({words}); is the address right?") from error


def _opened(url: str) -> Any:
    try:
        import fsspec  # noqa: PLC0415  (an extra)
    except ImportError:
        raise ReplayError(f"{url}: URLs need fsspec: pip install 'amaze_autonomy[cluster]'") from None
    return fsspec.open(url, "rb")
