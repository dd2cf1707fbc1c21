"""A ball thrown in a side wind: the distance between its track and a filmed one.

    python simulator.py attributes.json

Reads an interval for every attribute and a seed, throws balls with values drawn from the intervals,
and prints the score as JSON. It does not import sdr-jax and needs only Python.
"""

import json
import math
import random
import sys

GRAVITY = 9.81  # m/s^2
STEP = 0.01  # s
FRAMES = 12  # of the film, 0.25 s apart
THROWS = 20
BLUR = 0.3  # m, standard deviation of the ball's position in the film

# Stands in for a film: the true throw, which the search does not see.
FILMED = {"speed": 27.0, "elevation": 42.0, "drag": 0.012, "wind": -3.0}


def track(speed: float, elevation: float, drag: float, wind: float) -> list[tuple[float, ...]]:
    """The ball's position in every frame: metres ahead, above the hand, and to the side."""
    x = y = z = w = 0.0
    u = speed * math.cos(math.radians(elevation))
    v = speed * math.sin(math.radians(elevation))
    positions: list[tuple[float, ...]] = []
    for step in range(1, FRAMES * 25 + 1):
        through_air = math.hypot(u, v, w - wind)
        u -= STEP * drag * through_air * u
        v -= STEP * (drag * through_air * v + GRAVITY)
        w -= STEP * drag * through_air * (w - wind)
        x, y, z = x + STEP * u, y + STEP * v, z + STEP * w
        if step % 25 == 0:
            positions.append((x, y, z))
    return positions


def error(rng: random.Random, intervals: dict[str, dict[str, float]]) -> float:
    """The mean distance between the thrown balls and the filmed ball, in metres."""
    filmed = track(**FILMED)
    total = 0.0
    for _ in range(THROWS):
        values = {
            name: rng.uniform(interval["low"], interval["high"])
            for name, interval in intervals.items()
        }
        for position, target in zip(track(**values), filmed, strict=True):
            total += math.hypot(
                *(a - b + rng.gauss(0, BLUR) for a, b in zip(position, target, strict=True))
            )
    return total / (THROWS * FRAMES)


def main() -> None:
    """Read the file that the command line names, and print the score."""
    with open(sys.argv[1], encoding="utf-8") as file:
        task = json.load(file)
    print(f"{THROWS} throws for evaluation {task['evaluation']}")  # only the last line counts
    print(json.dumps({"score": error(random.Random(task["seed"]), task["attributes"])}))


if __name__ == "__main__":
    main()
