"""Readers of real labelled images, as they are on disk."""

from seg.data.camvid import list_camvid, read_camvid
from seg.data.cityscapes import list_cityscapes, read_cityscapes
from seg.data.folders import LAYOUTS, list_folders, read_folders
from seg.data.labelled import Entry, LabelledImages, load, subset
from seg.data.labelmefacade import (
    list_labelmefacade,
    load_labelmefacade,
    read_labelmefacade,
)
from seg.data.unlabelled import list_unlabelled, load_unlabelled
from seg.errors import DataError

__all__ = [
    "LAYOUTS",
    "DataError",
    "Entry",
    "LabelledImages",
    "list_camvid",
    "list_cityscapes",
    "list_folders",
    "list_labelmefacade",
    "list_unlabelled",
    "load",
    "load_labelmefacade",
    "load_unlabelled",
    "read_camvid",
    "read_cityscapes",
    "read_folders",
    "read_labelmefacade",
    "subset",
]
