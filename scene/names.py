"""Names that command lines offer; importing them loads no renderers or assets."""

RENDERERS: tuple[str, ...] = ("embree", "opengl")
"""Names for `scene.renderer`."""
USES = ("both", "own", "built-in")
"""Values of ``AssetPool.use``: which assets a street may draw from."""
OVERLAPS = ("allow", "avoid")
"""Values of ``AssetPool.overlap``, beside none: whether objects may stand in each other."""
WEATHERS = ("clear", "fog", "rain", "snow", "night")
"""Values of ``AssetPool.weather``, beside none: the weather of all streets."""
PLACES = ("sidewalk", "carriageway")
"""Values of ``OwnClass.place``: where the objects of a user's own class stand."""
OWN_EVERY = 15
"""Metres of a street on which one of them stands, if there is room."""
HELD = "hold an attribute at a value, in its unit, such as field_of_view=90; may be repeated"
"""The help of ``--fix``."""
