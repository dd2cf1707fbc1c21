"""All asset families, in the order of the catalogue and of the lines in a street."""

from __future__ import annotations

from scene.assets import (
    bicycle,
    bollard,
    building,
    bus,
    bush,
    car,
    company,
    fence,
    lamp,
    land,
    motorcycle,
    paving,
    person,
    rider,
    scaffold,
    shelter,
    signpost,
    slab,
    traffic_light,
    traffic_sign,
    train,
    tree,
    truck,
    wall,
)
from scene.assets.family import Family

FAMILIES: dict[str, Family] = {
    module.FAMILY.name: module.FAMILY
    for module in (
        building, train, fence, wall, tree, bush, bicycle, motorcycle, person, rider,
        lamp, signpost, traffic_sign, traffic_light, car, bus, truck, slab,
        land, paving, bollard, shelter, scaffold, company,
    )
}  # fmt: skip
"""Families by name."""
