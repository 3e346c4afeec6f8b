import stat

import pytest

from pipeline.errors import InputError
from pipeline.plant import effects
from pipeline.plant.sealed.seal import contents, open_seal, write_seal


def test_what_is_sealed_comes_out_again_and_cannot_be_read_by_accident(tmp_path, nominal):
    path = tmp_path / "truth.seal"
    drawn = [effects.draw("delay", 1, nominal, 1.0)]
    write_seal(path, drawn)
    assert open_seal(path) == contents(drawn)
    assert stat.S_IMODE(path.stat().st_mode) == 0o400
    assert "delay" not in path.read_text().split("\n", 1)[1]
    first = path.read_bytes()
    write_seal(path, drawn)
    assert path.read_bytes() == first


def test_null_case_is_an_empty_list(tmp_path):
    write_seal(tmp_path / "truth.seal", [])
    assert open_seal(tmp_path / "truth.seal") == []


@pytest.mark.parametrize("damage", ["checksum", "text", "other", "absent"])
def test_damage_is_found(tmp_path, nominal, damage):
    path = tmp_path / "truth.seal"
    if damage != "absent":
        write_seal(path, [effects.draw("delay", 1, nominal, 1.0)])
        lines = path.read_text().splitlines()
        path.unlink()
        if damage == "checksum":
            lines[1] = "sha256 " + "0" * 64
        elif damage == "text":
            lines[2] = lines[2][:-4]
        else:
            lines = ["not a seal"]
        path.write_text("\n".join(lines) + "\n")
    with pytest.raises(InputError, match=r"truth\.seal"):
        open_seal(path)
