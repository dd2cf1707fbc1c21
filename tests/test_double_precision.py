"""With JAX's double precision, searches, networks and saved models are those of single precision."""

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import sdr_jax
import seg
from tests.conftest import ROOT

SPACE = sdr_jax.space(
    list("abcd"), bins=[2, 5, 3, 10], groups=[["c"], ["a", "d", "b"]], unordered=["b"]
)
ON = jax.config.jax_enable_x64
"""Whether this process is the child of `test_in_double_precision`, which runs the other tests."""


def test_in_double_precision():
    words = (
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-x",
        "-p",
        "no:cacheprovider",
        str(Path(__file__)),
    )
    child = subprocess.run(
        words, cwd=ROOT, env={**os.environ, "JAX_ENABLE_X64": "1"}, capture_output=True, text=True
    )
    assert child.returncode == 0 and "passed" in child.stdout, child.stdout[-2000:]


def types_of(tree) -> set[str]:
    return {str(leaf.dtype) for leaf in jax.tree.leaves(tree)}


if ON:
    del test_in_double_precision

    @pytest.mark.parametrize("name", sdr_jax.METHODS)
    def test_a_search_is_of_single_precision_and_goes_as_driven_from_the_host(name):
        method = sdr_jax.METHODS[name](SPACE)

        def reward(rng_key, proposal, actions):
            return -jnp.sum((proposal.centre - 0.3) ** 2, axis=-1).astype(jnp.float32)

        key = jax.random.key(0)
        state, record = sdr_jax.run(key, method, reward, updates=4, n=4)
        assert not types_of((state, record)) & {"float64", "int64"}
        driven = list(sdr_jax.drive(key, method, reward, updates=4, n=4))
        assert len(driven) == 4
        np.testing.assert_array_equal(driven[-1][1].actions, record.actions[-1])

    @pytest.mark.parametrize("recipe", [None, "lite0-heads"])
    def test_networks_have_single_precision(recipe):
        settings = seg.TrainSettings() if recipe is None else seg.RECIPES[recipe]
        settings = replace(settings, steps=2, warmup=0, batch=2, views=1)
        rng = np.random.default_rng(0)
        images = rng.integers(0, 256, (2, 32, 32, 3), np.uint8)
        labels = rng.integers(0, 3, (2, 32, 32)).astype(np.uint8)
        assert types_of(seg.train(0, images, labels, settings, 3)) == {"float32"}

    def test_a_saved_model_is_loaded():
        model = seg.load_model("renders19")
        assert model.predict(np.zeros((1, 32, 32, 3), np.uint8)).shape == (1, 32, 32)
