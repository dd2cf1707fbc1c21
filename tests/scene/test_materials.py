"""Textures: multipliers of mean 1 that tile, one per material, from one table."""

import numpy as np
import pytest

from scene.look.materials import BRIGHTEST, DARKEST, MATERIALS, TEXTURE_SIZE, material_id, textures
from scene.look.patterns import PATTERNS, value_noise
from scene.look.surfaces import ASPHALT, DRIVES, FORECOURTS, ROADS, SIDEWALKS, TERRAINS, VERGES


def test_names_are_unique_surfaces_differ_and_noise_has_its_lattice_values():
    names = [m.name for m in MATERIALS]
    assert len(set(names)) == len(names) <= 256 and {m.pattern for m in MATERIALS} <= set(PATTERNS)
    with pytest.raises(ValueError, match="unknown material 'velvet'; known: plain, paint"):
        material_id("velvet")
    for surfaces in (ROADS, SIDEWALKS, TERRAINS, ASPHALT, VERGES, FORECOURTS, DRIVES):
        assert len({s.name for s in surfaces}) == len(surfaces) > 2
        assert min(textures()[material_id(s.material)].std() for s in surfaces) > 0.04
        assert len({(s.material, tuple(np.round(s.dark, 2))) for s in surfaces}) == len(surfaces)
    lattice = np.random.default_rng(5).random((4, 8), dtype=np.float32)
    noise = value_noise(np.random.default_rng(5), 64, (4, 8))
    np.testing.assert_array_equal(noise[::16, ::8], lattice)


def test_textures_are_multipliers_of_mean_one_and_of_the_contrast_of_the_table():
    stack = textures()
    assert stack.shape == (len(MATERIALS), TEXTURE_SIZE, TEXTURE_SIZE) and stack.dtype == np.float32
    np.testing.assert_allclose(stack.mean(axis=(1, 2)), 1, atol=1e-4)
    assert DARKEST / 2 <= stack.min() and stack.max() <= 2 * BRIGHTEST
    with pytest.raises(ValueError, match="read-only"):
        stack[0] = 0
    # Nearly every texel lies within 0.8 contrast of 1, and some lie near that bound.
    for material, texture in zip(MATERIALS, stack, strict=True):
        away = np.quantile(np.abs(texture - 1), 0.98)
        assert away == pytest.approx(0.8 * material.contrast, abs=0.12)


@pytest.mark.parametrize("name", sorted(PATTERNS))
def test_patterns_are_pure_and_tile(name):
    a, b = (PATTERNS[name](np.random.default_rng(3), 128) for _ in range(2))
    assert a.shape == (128, 128) and np.isfinite(a).all()
    np.testing.assert_array_equal(a, b)
    # Across the seam neighbours differ no more than they do somewhere inside.
    for pattern in (a, a.T):
        steps = np.abs(np.diff(pattern, axis=0, append=pattern[:1])).mean(axis=1)
        assert steps[-1] <= 1.5 * steps[:-1].max() + 1e-6
