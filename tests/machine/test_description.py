import copy

import jax
import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.machine.kinematics import load_arm
from pipeline.machine.scene import build_scene


@pytest.fixture
def edited(bobcat, machine_directory, tmp_path):
    """Loads the arm from a copy of the URDF in which one text is replaced by another."""

    def load(old: str, new: str):
        text = (machine_directory / bobcat.arm.urdf).read_text()
        assert old in text
        (tmp_path / bobcat.arm.urdf).write_text(text.replace(old, new))
        return load_arm(bobcat, tmp_path)

    return load


def test_missing_urdf_is_named(bobcat, tmp_path):
    with pytest.raises(InputError, match=r"bobcat_e10\.urdf: no such robot description"):
        load_arm(bobcat, tmp_path)


def test_machine_without_arm_is_named(bobcat, machine_directory):
    machine = copy.deepcopy(bobcat)
    machine.arm = None
    with pytest.raises(InputError, match=r"bobcat_e10\.yaml: no section arm"):
        load_arm(machine, machine_directory)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'joint name="arm" type',
            'joint name="stick" type',
            "no moving joint arm; it has swing, boom, stick, bucket",
        ),
        ('upper="1.2"', 'upper="1.3"', r"joint boom has limits \[-0.6, 1.3\], .* has \[-0.6, 1.2\]"),
        ('name="arm" type="revolute"', 'name="arm" type="prismatic"', "joint arm is not revolute"),
        ('"chisel_tip"', '"point"', "no link chisel_tip"),
        (
            'rpy="0 -1.5707963267948966 0"',
            'rpy="0 1.5707963267948966 0"',
            "correct its rpy or the joints' axes",
        ),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 -1"/>', "correct its rpy or the joints' axes"),
        ("</robot>", "", "not a readable URDF"),
    ],
)
def test_contradictions_are_told_in_one_line(edited, old, new, message):
    with pytest.raises(InputError, match=message) as caught:
        edited(old, new)
    assert "\n" not in str(caught.value)


def test_a_negative_mass_is_told_where_the_arm_is_drawn(bobcat, machine_directory, tmp_path):
    text = (machine_directory / bobcat.arm.urdf).read_text()
    (tmp_path / bobcat.arm.urdf).write_text(text.replace('<mass value="45"/>', '<mass value="-45"/>'))
    with pytest.raises(InputError, match=r"not a (readable URDF|valid robot description)"):
        build_scene(bobcat, tmp_path, 8, 8)


def test_further_moving_joint_is_refused(edited):
    rotator = """
      <joint name="rotator" type="continuous"><parent link="boom"/><child link="wheel"/></joint>
      <link name="wheel"><inertial><mass value="1"/>
        <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    </robot>"""
    with pytest.raises(InputError, match="joint rotator moves but is not a joint of machine bobcat_e10"):
        edited("</robot>", rotator)


def test_joint_order_is_the_machines_not_the_files(bobcat, machine_directory, forward):
    machine = copy.deepcopy(bobcat)
    machine.joints = machine.joints[::-1]
    q = np.array([0.3, 0.4, -1.2, -0.5])
    expected = forward(q).position
    reversed_arm = load_arm(machine, machine_directory)
    assert np.abs(jax.jit(reversed_arm.forward)(q[::-1]).position - expected).max() < 1e-6
    assert reversed_arm.yaw(q[::-1]) == 0.3
