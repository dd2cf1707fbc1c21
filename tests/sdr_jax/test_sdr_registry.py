"""One table of methods: their names, their options, and what they refuse."""

from typing import get_args

import jax
import numpy as np
import pytest

import sdr_jax
from sdr_jax import METHODS, MethodName, space
from sdr_jax.registry import make, options_of

SPACE = space(["a", "b", "c"], bins=[3, 5, 2], groups=[["b", "a"], ["c"]])
NAN, INF = float("nan"), float("inf")


def test_the_table_has_every_method_by_the_name_of_its_function() -> None:
    assert tuple(METHODS) == get_args(MethodName)
    assert all(callable(getattr(sdr_jax, name)) for name in METHODS)


@pytest.mark.parametrize("name", METHODS)
def test_a_method_is_made_with_its_own_options(name: str) -> None:
    method = make(name, SPACE, 0.2, **{k: v for k, v in options_of(name).items() if v is not None})
    _, proposals = method.sample(jax.random.key(1), method.init(jax.random.key(0)), 3)
    decided = np.asarray(proposals.width) < 1
    np.testing.assert_allclose(np.asarray(proposals.width)[decided], 0.2, rtol=1e-6)
    assert decided.any() == (name != "random_attributes")
    assert method.traced == (name not in ("cma_es", "tpe"))


def test_options_are_plain_values() -> None:
    assert "optimizer" not in options_of("sdr") and options_of("pbil")["memory"] == 60
    kinds = {type(v) for name in METHODS for v in options_of(name).values()}
    assert kinds <= {int, float, str, bool, type(None)}


@pytest.mark.parametrize(
    ("name", "options", "culprit"),
    [
        ("magic", {}, "unknown method 'magic'; known are actor_critic, sdr"),
        ("pbil", dict(speed=1), "pbil has no option 'speed'; known: rate"),
        ("random_search", dict(speed=1), "known: none"),
        ("actor_critic", dict(temperature=0.0), "temperature is 0.0"),
        ("actor_critic", dict(temperature=NAN), "temperature is nan"),
        ("actor_critic", dict(degree=0), "degree is 0"),
        ("actor_critic", dict(pair_degree=10), "pair_degree is 10"),
        ("sdr", dict(updates_per_group=0), "updates_per_group is 0"),
        ("sdr", dict(unoptimised="zero"), "unoptimised is 'zero'"),
        ("sdr", dict(baseline="none"), "baseline is 'none', but must be one of ema, ema_current"),
        ("attribute_descent", dict(repeats=0), "repeats is 0"),
        ("attribute_descent", dict(unoptimised="zero"), "unoptimised is 'zero'"),
        ("gaussian", dict(std=0.0), "std is 0.0"),
        ("pbil", dict(rate=0.0), "rate is 0.0"),
        ("pbil", dict(elite=1.5), "elite is 1.5"),
        ("pbil", dict(memory=0), "memory is 0"),
        ("pbil", dict(smoothing=-1.0), "smoothing is -1.0"),
        ("pbil", dict(smoothing=NAN), "smoothing is nan"),
        ("linear", dict(explore=-1.0), "explore is -1.0"),
        ("linear", dict(degree=0), "degree is 0"),
        ("linear", dict(pair_degree=5), "pair_degree is 5"),
        ("linear", dict(interaction=INF), "interaction is inf"),
        ("cma_es", dict(sigma=0.0), "sigma is 0.0"),
        ("cma_es", dict(population=1), "population is 1"),
        ("tpe", dict(startup=-1), "startup is -1"),
        *((name, dict(width=2.0), "width is 2.0") for name in METHODS if name != "random_attributes"),
    ],
)  # fmt: skip
def test_bad_options_are_refused(name: str, options: dict, culprit: str) -> None:
    with pytest.raises(ValueError, match=culprit):
        make(name, SPACE, **options)


def test_cma_es_needs_two_attributes() -> None:
    with pytest.raises(ValueError, match="this space has 1"):
        make("cma_es", space(["a"]))
