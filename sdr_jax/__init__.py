"""Learning to simulate complex scenes: the optimiser, without scenes or images.

    attributes = space(["car", "tree", "sun"], groups=[["car", "tree"], ["sun"]])
    method = sdr(attributes)
    reward_fn = lambda rng_key, proposals, actions: -((proposals.centre - 0.3) ** 2).sum(axis=1)
    state, record = jax.jit(lambda key: run(key, method, reward_fn, n=4))(jax.random.key(0))
    method.solution(state)  # centre and width of every attribute

`host_reward` is for a reward that must leave JAX, such as rendering images and training on them.
`space(["car", "weather"], bins=[10, 3], unordered=["weather"])` has an attribute without an order.
`AskTell` waits for rewards from elsewhere; `sdr-jax tune` takes them from a program.
"""

from lazy_loader import attach_stub

from common.interrupt import while_loading

while_loading(__name__)  # before JAX
__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
