"""Learning to simulate complex scenes: the optimiser, without scenes or images.

    attributes = space(["car", "tree", "sun"], groups=[["car", "tree"], ["sun"]])
    method = sdr(attributes)
    reward_fn = lambda rng_key, proposals, actions: -((proposals.centre - 0.3) ** 2).sum(axis=1)
    state, record = jax.jit(lambda key: run(key, method, reward_fn, n=4))(jax.random.key(0))
    method.solution(state)  # centre and width of every attribute

`host_reward` is for a reward that must leave JAX, such as rendering images and training on them.
`space(["car", "weather"], bins=[10, 3], unordered=["weather"])` has an attribute without an order.
`AskTell` waits for rewards from elsewhere; `sdr-jax tune` takes them from a program.

Each idea of the paper (arXiv 2006.14611, section 4) is one file:

    N attributes, K bins, n groups          space.py
    policy pi_phi, an MLP                   policy.py
    grad J(phi), REINFORCE                  reinforce.py
    baseline b, a moving average            baseline.py
    relaxation of theta'                    relaxation.py
    J_i, SDR in groups                      coordinate_descent.py
    the method; the loop                    sdr.py; run.py

theta are random attributes, theta' those that a policy chose. The paper's other K, the data sets of one
update, is n here.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
