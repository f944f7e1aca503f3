"""Densities from speeds."""

import jax.numpy as jnp
import numpy as np
import pytest

from sidestep.walking.speed_laws import DENSEST, Aoki, Weidmann, density_at_speed


def test_speeds_become_the_densities_that_make_them() -> None:
    for law in (Weidmann(), Aoki(), Aoki(capped=False)):
        density = np.linspace(1.05, 4.5, 20).astype(np.float32).reshape(4, 5)
        found = density_at_speed(law, np.asarray(law.speed(jnp.asarray(density))))
        np.testing.assert_allclose(found, density, rtol=1e-5)
    assert density_at_speed(Weidmann(), np.array([1.34, 1.5, 13.0])).tolist() == [0, 0, 0]
    # 1.34 (1 - exp(-1.913 (1/p - 1/5.4))) = .05: 1/p = 1/5.4 - ln(1 - .05/1.34) / 1.913 = .205066
    assert density_at_speed(Weidmann(), np.array([0.05, 0.01, 0.0])).tolist() == pytest.approx([4.87648] * 3, rel=1e-4)
    # 1.34 p^-.8 = .67: p = 2^1.25
    assert density_at_speed(Aoki(), np.array([0.67, 0.1])).tolist() == pytest.approx([2.378414, DENSEST])
