import pytest

from pipeline.errors import InputError
from pipeline.machine.chain import read_chain


@pytest.mark.parametrize("text", ["<robot>", '<robot><joint name="swing" type="revolute"/></robot>'])
def test_broken_file_is_told_in_one_line(bobcat, tmp_path, text):
    (tmp_path / bobcat.arm.urdf).write_text(text)
    with pytest.raises(InputError, match="not a readable URDF") as caught:
        read_chain(bobcat, tmp_path)
    assert "\n" not in str(caught.value)
