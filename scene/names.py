"""Names for command lines; importing them loads no renderers or assets."""

RENDERERS: tuple[str, ...] = ("embree", "opengl")
"""Names for `scene.renderer`."""
USES = ("both", "own", "built-in")
"""Values of ``AssetPool.use``: which assets a street may draw from."""
OVERLAPS = ("allow", "avoid")
"""Values of ``AssetPool.overlap`` other than none: whether objects may overlap."""
WEATHERS = ("clear", "fog", "rain", "snow", "night")
"""Values of ``AssetPool.weather`` other than none: the weather of all streets."""
PLACES = ("sidewalk", "carriageway")
"""Values of ``OwnClass.place``: where objects of a user's own class are placed."""
OWN_EVERY = 15
"""Metres of a street per object of a user's own class, where there is room."""
HELD = "fix an attribute at a value, in its unit, such as field_of_view=90; may be repeated"
"""The help of ``--fix``."""
