"""The format of labelled images: the engine's classes, files of targets, and the images that they list.

`scene` renders these classes and `seg` learns them, and neither imports the other, so the format lies below
both. The files of targets that come with the package are in ``targets/``.
"""
