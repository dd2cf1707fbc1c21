"""Open a local page with a slider for each attribute and the street that they describe.

    sdr-jax playground
    sdr-jax playground --space extended --size 640x360 --no-browser
    sdr-jax playground --attributes runs/main/attributes.json --real DIR

The page needs the extra playground: pip install 'sdr-jax[playground]'.
"""

from __future__ import annotations

import argparse
from importlib.util import find_spec

from common.command import Arguments, exit_code
from common.errors import UserError
from common.loopback import check_port
from experiments.app.playground.photographs import listed
from experiments.app.playground.state import (
    LOSS,
    State,
    View,
    check_view,
    has_probabilities,
    opened,
)
from experiments.config.parsers import playground as parser
from scene.assets.catalogue import AssetPool
from scene.proposal import read_streets
from scene.render import RendererError, renderer


def first_state(options: argparse.Namespace) -> State:
    """The first state of a page.

    Raises:
        ValueError: an option is out of range; the message names it.
        UserError: there is no such file, or it has no attributes; the message names it.
        OSError: the file cannot be read.
    """
    width, height = options.size
    pool = AssetPool(own=options.assets)
    view = View(options.seed, 0, 0, options.shots, width, height, options.samples, pool)
    try:
        streets = read_streets(options.attributes, options.space)
    except UserError as error:
        raise UserError(f"--attributes {error}") from None
    if has_probabilities(streets):
        print(f"{options.attributes}: {LOSS}", flush=True)
    return opened(streets, check_view(view))


def main(arguments: Arguments = None) -> int:
    """The command line; returns the exit code."""
    options = parser().parse_args(arguments)

    def work() -> None:
        if find_spec("nicegui") is None:
            raise UserError("the playground needs NiceGUI: pip install 'sdr-jax[playground]'")
        check_port(options.port)
        state, photographs = first_state(options), listed(options.real)
        renderer("embree")
        from experiments.app.playground.page import serve

        serve(state, photographs, options.port, not options.no_browser)

    return exit_code(work, users=(ValueError, RendererError), debug=options.debug, resumes=False)
