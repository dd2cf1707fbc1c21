"""SceneX: a street-scene engine with exact labels of the 19 Cityscapes classes."""
