"""One way to compile a kernel, so that every hot loop has the same rules.

Kernels are cached on disk (the first run of a new installation compiles them, some seconds), release
the GIL so that threads can run them, and follow NumPy's rules for division. No `parallel=True` and no
eager signatures: both make the first run slower. No `fastmath`: it would let the compiler reorder sums,
and the same input must give the same bytes everywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from hashlib import blake2b
from pathlib import Path
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile `function` lazily in nopython mode; the decorated function keeps its type."""
    return _compiled(function)


def leaf(function: F) -> F:
    """A kernel that makes no array, compiled without counting the references to those that it is given.

    The counts are atomic: a helper that is called for every pixel spends more time on them than on its
    work, and threads that share a picture wait for each other.
    """
    return _compiled(function, _nrt=False)


def _compiled(function: F, **options: Any) -> F:
    options = {"nogil": True, "error_model": "numpy", **options}
    try:
        dispatcher: Any = numba.njit(cache=True, **options)(function)
    except RuntimeError:
        # Numba finds no place it may write a cache to (read-only installation, no home directory).
        return numba.njit(**options)(function)  # type: ignore[no-any-return]
    # Numba recompiles a cached kernel when its own file changes, and would miss a change in a kernel
    # that it calls from another file: stamp the cache with all of them.
    dispatcher._cache._cache_file._source_stamp = _sources()
    return dispatcher  # type: ignore[no-any-return]


@cache
def _sources() -> str:
    """Digest of every module that holds kernels."""
    digest = blake2b()
    for module in sorted(Path(__file__).parent.rglob("*.py")):
        source = module.read_bytes()
        if b"@kernel" in source or b"@leaf" in source:
            digest.update(source)
    return digest.hexdigest()


def is_cached(function: Callable[..., Any]) -> bool:
    """Whether a kernel has been compiled on this machine, so that its first call will be quick."""
    cache_impl = getattr(function, "_cache", None)
    cache_file = getattr(cache_impl, "_cache_file", None)
    return cache_file is not None and bool(cache_file._load_index())
