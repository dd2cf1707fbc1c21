"""Pedestrians and riders: how they move, what they wear, and their fit on machines."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene.assets import bicycle, motorcycle, person, rider
from scene.assets.parts.carried import CARRIED, carried
from scene.assets.parts.head import HAIRDOS, HATS, head
from scene.assets.parts.human import FOREARM, HAND, UPPER_ARM, Body, bend
from scene.assets.parts.wardrobe import STYLES, sample_outfit
from tests.scene.conftest import SEEDS, mirror


@pytest.mark.parametrize("kind", rider.KINDS)
@given(seed=SEEDS)
def test_riders_reach_saddle_bar_and_feet_of_their_machine(kind, seed):
    machine = {"bicycle": bicycle, "motorcycle": motorcycle}[rider.MOUNT[kind]]
    params = rider.sample_rider(np.random.default_rng(seed), kind)
    assert params.mount == rider.MOUNT[kind]
    vertices = rider.rider(params).mesh.vertices
    feet = machine.pedals() if machine is bicycle else (machine.FOOT, mirror(machine.FOOT))
    for point in (machine.SADDLE, machine.BAR, mirror(machine.BAR), *feet):
        nearest = np.linalg.norm(vertices - np.array(point), axis=1).min()
        assert nearest < (0.16 if point == machine.SADDLE else 0.12)
    shoulders = vertices[vertices[:, 2] > machine.BAR[2] + 0.1]  # arms are not stretched
    reach = np.linalg.norm(shoulders - np.array(machine.BAR), axis=1).min()
    assert reach < (UPPER_ARM + FOREARM + HAND) * params.body.height


def walker(phase):
    """Someone who strides out, at one phase of the step."""
    params = person.sample_person(np.random.default_rng(8), "walking in a jacket")
    return params._replace(gait="walk", phase=phase, vigour=1.0)


@pytest.mark.parametrize(("phase", "sign"), [(0.0, 1), (0.5, -1)])
def test_people_walk_on_two_legs_that_take_turns(phase, sign):
    vertices = person.person(walker(phase)).mesh.vertices
    low = vertices[vertices[:, 2] < 0.16]
    left, right = (low[low[:, 1] * side > 0, 0].mean() for side in (1, -1))
    assert sign * (left - right) > 0.4  # metres ahead


@pytest.mark.parametrize("phase", np.linspace(0, 0.9, 10))
def test_arms_swing_against_the_legs_and_one_shoe_is_on_the_ground(phase):
    mesh = person.person(walker(phase)).mesh
    assert mesh.bounds[0, 2] == pytest.approx(0, abs=1e-9)
    pose = person._pose(walker(phase))
    legs = pose.ankles[0][0] - pose.ankles[1][0]
    arms = pose.hands[0][0] - pose.hands[1][0]
    if abs(legs) > 0.3:
        assert legs * arms < 0


@pytest.mark.parametrize("style", STYLES)
def test_every_style_dresses_a_body_of_one_height(style):
    outfit, curves = sample_outfit(np.random.default_rng(1), style, 0.3)
    params = walker(0.2)._replace(outfit=outfit._replace(hat=""), things=())
    params = params._replace(body=Body(1.75, curves=curves))
    assert 1.66 < person.person(params).mesh.bounds[1, 2] < 1.84


@pytest.mark.parametrize("hat", HATS)
@pytest.mark.parametrize("hairdo", HAIRDOS)
def test_hats_cover_the_crown_and_leave_the_body_alone(hat, hairdo):
    params = walker(0.1)
    bare = params.outfit._replace(hat="", hairdo="bald")
    red = (0.5, 0.01, 0.01)
    worn = bare._replace(hat=hat, hairdo=hairdo, hat_color=red)
    pose = person._pose(params)
    before, after = (head(params.body, outfit, pose) for outfit in (bare, worn))
    assert after.mesh.bounds[1, 2] > before.mesh.bounds[1, 2]
    assert (after.color == np.float32(red)).all(axis=1).any()


@pytest.mark.parametrize("thing", CARRIED)
def test_things_are_carried_above_the_ground_and_near_a_hand(thing):
    params = person.sample_person(np.random.default_rng(3), "shopping bags")
    params = params._replace(things=(thing,), body=Body(1.75), gait="stand")
    bare = person.person(params._replace(things=())).mesh.vertices
    added = person.person(params).mesh.vertices[len(bare) :]
    assert len(added) >= 8 and added[:, 2].min() > -0.02
    assert np.linalg.norm(added[:, None] - bare[None, ::7], axis=2).min() < 0.25


def test_unknown_names_are_refused():
    with pytest.raises(ValueError, match="unknown style"):
        sample_outfit(np.random.default_rng(0), "marble", 0.0)
    with pytest.raises(ValueError, match="unknown thing"):
        carried("marble", Body(1.7), person._pose(walker(0.0)), (0, 0, 0), (0, 0, 0))


def test_bend_is_a_right_angle_for_three_four_five():
    for end, lower, joint in (
        (5.0, 4.0, [1.8, 0, 2.4]),
        (8.0, 1.0, [6, 0, 0]),
    ):  # the other: straight
        found = bend(np.zeros(3), np.array([end, 0, 0]), 3.0, lower, (0, 0, 1))
        np.testing.assert_allclose(found, joint)


BONE = st.floats(0.2, 0.5)
TOWARDS = st.tuples(st.floats(0.1, 1), st.floats(-1, 1), st.floats(0.1, 1))


@given(SEEDS, BONE, BONE, TOWARDS)
def test_bend_keeps_bone_lengths(seed, upper, lower, towards):
    direction = np.random.default_rng(seed).normal(size=3)
    distance = 0.5 * (abs(upper - lower) + upper + lower)
    end = distance * direction / np.linalg.norm(direction)
    joint = bend(np.zeros(3), end, upper, lower, towards)
    np.testing.assert_allclose(np.linalg.norm(joint), upper, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(end - joint), lower, rtol=1e-6)
