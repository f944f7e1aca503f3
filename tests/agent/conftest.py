"""Compiled programs of one module are of no use to the next, and would fill the memory."""

from collections.abc import Iterator

import jax
import pytest


@pytest.fixture(scope="module", autouse=True)
def _forget_compiled() -> Iterator[None]:
    yield
    jax.clear_caches()
