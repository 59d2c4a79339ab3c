"""One way to compile a kernel, so that every hot loop has the same rules.

Kernels are cached on disk (the first run of a new installation compiles them, some seconds), release
the GIL so that threads can run them, and follow NumPy's rules for division. No `parallel=True` and no
eager signatures: both make the first run slower. No `fastmath`: it would let the compiler reorder sums,
and the same input must give the same bytes everywhere.

What a kernel that is already compiled does not need is left out (see `_Cache`): Numba's own way takes 0.4 s a
process to come to the first call. It takes names that Numba keeps to itself; with a Numba that lacks one of them,
kernels are compiled and cached in Numba's own way.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, cached_property
from hashlib import blake2b
from pathlib import Path
from typing import Any, TypeVar

import numba

try:
    from numba.core.caching import FunctionCache, IndexDataCacheFile, NullCache
    from numba.core.cpu import CPUTargetOptions
    from numba.core.runtime.nrt import rtsys
except ImportError:  # of a Numba that has them no more
    FunctionCache = IndexDataCacheFile = NullCache = CPUTargetOptions = rtsys = None  # type: ignore[assignment, misc]

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


def inlined(function: F) -> F:
    """A leaf whose code is put wherever it is called, for what is called a million times with a dozen arguments.

    The compiler leaves it a function of its own where it looks too long, and a call of it then takes half of its time.
    """
    return _compiled(function, _nrt=False, forceinline=True)


def _compiled(function: F, **options: Any) -> F:
    rules: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
    if not _known():
        return _in_numbas_way(function, rules)
    dispatcher: Any = numba.njit(**rules, **options)(function)
    dispatcher._cache = _Cache(function, counts=options.get("_nrt", True))
    return dispatcher  # type: ignore[no-any-return]


@cache
def _known() -> bool:
    """Whether this Numba has all that `_Cache` takes from it."""
    needed = (
        (FunctionCache, "_load_overload", "load_overload", "save_overload", "_guard_against_spurious_io_errors"),
        (IndexDataCacheFile, "_load_index"),
        (NullCache, "load_overload"),
        (CPUTargetOptions, "_nrt"),
        (rtsys, "initialize"),
    )
    return all(hasattr(owner, name) for owner, *names in needed for name in names)


def _in_numbas_way(function: F, rules: dict[str, Any]) -> F:
    try:
        return numba.njit(cache=True, **rules)(function)  # type: ignore[no-any-return]
    except RuntimeError:  # no place for a cache
        return numba.njit(**rules)(function)  # type: ignore[no-any-return]


class _Cache:
    """Numba's cache of one function, opened when the function is first called from Python or compiled.

    Most kernels are only called from others, which hold their code: they need no place on disk, and to find one
    takes a millisecond. A cached kernel is loaded without the registries of all that Numba can compile (most of
    Numba, and scipy.linalg); they are there if one has to be compiled.
    """

    def __init__(self, function: Callable[..., Any], counts: bool) -> None:
        self._function = function
        self._counts = counts
        """Whether it counts references, for which Numba has a run-time library of its own to load."""

    @cached_property
    def opened(self) -> FunctionCache | NullCache:
        try:
            opened = FunctionCache(self._function)  # type: ignore[no-untyped-call]
        except RuntimeError:
            # Numba finds no place it may write a cache to (read-only installation, no home directory).
            return NullCache()
        # Numba recompiles a cached kernel when its own file changes, and would miss a change in a kernel
        # that it calls from another file: stamp the cache with all of them.
        opened._cache_file._source_stamp = _sources()
        return opened

    def load_overload(self, signature: Any, target: Any) -> Any:
        if isinstance(self.opened, NullCache):
            return None
        if self._counts:
            rtsys.initialize(target)
        with self.opened._guard_against_spurious_io_errors():
            return self.opened._load_overload(signature, target)  # type: ignore[no-untyped-call]

    def __getattr__(self, name: str) -> Any:
        return getattr(self.opened, name)


@cache
def _sources() -> str:
    """Digest of every module that holds kernels."""
    digest = blake2b()
    for module in sorted(Path(__file__).parent.rglob("*.py")):
        source = module.read_bytes()
        if b"@kernel" in source or b"@leaf" in source or b"@inlined" in source:
            digest.update(source)
    return digest.hexdigest()


def is_cached(function: Callable[..., Any]) -> bool:
    """Whether a kernel has been compiled on this machine, so that its first call will be quick."""
    if not _known():
        return True  # Numba's own way does not tell
    opened: Any = function._cache.opened  # type: ignore[attr-defined]
    return not isinstance(opened, NullCache) and bool(opened._cache_file._load_index())
