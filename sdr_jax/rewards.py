"""What is done to a reward before the method learns from it."""

from jaxtyping import Array, Float


def identity(rewards: Float[Array, "n"]) -> Float[Array, "n"]:
    """The score itself, as in the paper."""
    return rewards


def squared_percent(rewards: Float[Array, "n"]) -> Float[Array, "n"]:
    """`(100 r)^2`, as in the authors' code: differences between good scores count for more.

    Only for rewards >= 0, such as a mean IoU in [0, 1].
    """
    return (100 * rewards) ** 2
