"""Numba's compiler, for the modules with kernels: whoever imports one hears in words when nothing can be compiled."""

from vision import kernel_cache

kernel_cache.require()

from numba import njit  # noqa: E402

__all__ = ["njit"]
