"""Names that command lines offer, apart from what bears them: no net is loaded."""

from typing import Literal

As = Literal["ids", "colours", "overlay"]
"""What is written of a prediction; an overlay is half image, half colours."""
