import numpy as np
import pytest

from pipeline.errors import InputError
from pipeline.machine.chain import read_chain


def test_tip_is_where_brax_has_it(bobcat, machine_directory, forward):
    q = np.random.default_rng(0).uniform(bobcat.lower, bobcat.upper, (50, bobcat.n_joint))
    pose = forward(q)
    position, rotation = read_chain(bobcat, machine_directory).forward(q)
    np.testing.assert_allclose(position, pose.position, atol=2e-6)
    w, x, y, z = np.asarray(pose.quaternion, np.float64).T
    tip_axis = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=1)
    np.testing.assert_allclose(rotation[:, :, 0], tip_axis, atol=2e-6)


@pytest.mark.parametrize("text", ["<robot>", '<robot><joint name="swing" type="revolute"/></robot>'])
def test_broken_file_is_told_in_one_line(bobcat, tmp_path, text):
    (tmp_path / bobcat.arm.urdf).write_text(text)
    with pytest.raises(InputError, match="not a readable URDF") as caught:
        read_chain(bobcat, tmp_path)
    assert "\n" not in str(caught.value)
