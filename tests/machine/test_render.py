import mujoco
import numpy as np
import pytest
from PIL import Image

from pipeline.errors import InputError
from pipeline.machine.kinematics import Pose
from pipeline.machine.offscreen import create_context
from pipeline.machine.render import VIEWS, ArmRenderer, render_film, render_frame, save_film
from pipeline.machine.scene import build_scene
from pipeline.machine.sector import sector_edges, sector_surface
from tests.machine.reference import chisel_transform

WIDTH, HEIGHT = 160, 120
CONFIGURATION = np.array([0.0, 0.75, -1.7, -0.5])


@pytest.fixture(scope="module")
def renderer(bobcat, machine_directory):
    try:
        create_context(WIDTH, HEIGHT).free()
    except InputError as error:
        pytest.skip(f"no offscreen OpenGL here: {error}")
    with ArmRenderer(bobcat, machine_directory, WIDTH, HEIGHT) as renderer:
        yield renderer


def target_at(y: float) -> Pose:
    return Pose(np.array([1.6, y, 0.6]), np.array([1.0, 0.0, 0.0, 0.0]))


def test_sector_has_the_volume_of_its_formula(bobcat):
    """The divergence theorem gives the volume only if every triangle faces outwards."""
    vertices, triangles = sector_surface(bobcat.workspace)
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    expected = 0.85 * (2.6**2 - 0.9**2) * (2.5 - 0.155)
    assert abs(volume / expected - 1.0) < 1e-3  # the arcs are polygons
    assert len(sector_edges(bobcat.workspace)) == 12


def test_scene_holds_the_tip_where_the_contract_puts_it(bobcat, machine_directory):
    model = build_scene(bobcat, machine_directory, WIDTH, HEIGHT)
    data = mujoco.MjData(model)
    for name, value in zip(bobcat.joint_names, CONFIGURATION, strict=True):
        data.joint(name).qpos = value
    mujoco.mj_kinematics(model, data)
    assert np.abs(data.body("chisel_tip").xpos - chisel_transform(CONFIGURATION)[:3, 3]).max() < 1e-9
    assert not model.geom_contype.any()  # nothing may collide: it is a picture


def test_every_view_shows_something_and_follows_the_arm(renderer):
    for view in VIEWS:
        first = renderer.frame(CONFIGURATION, view=view)
        assert first.shape == (HEIGHT, WIDTH, 3) and first.dtype == np.uint8
        assert first.std() > 10.0
        second = renderer.frame(CONFIGURATION + np.array([0.5, 0.0, 0.0, 0.0]), view=view)
        assert (first != second).any(axis=-1).mean() > 0.005
        assert np.array_equal(first, renderer.frame(CONFIGURATION, view=view))


def test_target_appears_on_its_side(renderer):
    """From above, left of the machine (y > 0) is the upper half of the picture."""
    plain = renderer.frame(CONFIGURATION, view="top").astype(int)
    rows = []
    for y in (0.7, -0.7):
        picture = renderer.frame(CONFIGURATION, target_at(y), view="top").astype(int)
        changed = np.abs(picture - plain).sum(axis=-1) > 60
        assert changed.any()
        rows.append(np.nonzero(changed)[0].mean())
    assert rows[0] < HEIGHT / 2 < rows[1]


def test_film_is_written_and_read_back(bobcat, machine_directory, renderer, tmp_path):
    configurations = CONFIGURATION + np.linspace(0.0, 0.4, 3)[:, None] * np.array([1.0, 0.0, 0.0, 0.0])
    positions = np.stack([chisel_transform(q)[:3, 3] for q in configurations])
    pictures = render_film(
        bobcat, machine_directory, configurations, [target_at(0.3)] * 3, positions, WIDTH, HEIGHT
    )
    for suffix in ("webp", "gif"):
        save_film(pictures, tmp_path / f"film.{suffix}", frames_per_second=10.0)
        with Image.open(tmp_path / f"film.{suffix}") as film:
            assert film.n_frames == 3 and film.size == (WIDTH, HEIGHT)
    with pytest.raises(InputError, match=r"\.webp or \.gif"):
        save_film(pictures, tmp_path / "film.mp4", 10.0)
    with pytest.raises(InputError, match="no picture"):
        save_film([], tmp_path / "film.gif", 10.0)


def test_unknown_view_and_missing_workspace_are_told(bobcat, machine_directory, renderer):
    with pytest.raises(InputError, match="no view 'front' of the machine; there are overview"):
        renderer.frame(CONFIGURATION, view="front")
    bare = type(bobcat)(bobcat.name, bobcat.rate_hz, bobcat.joints, arm=bobcat.arm)
    with pytest.raises(InputError, match="no section workspace"):
        render_frame(bare, machine_directory, CONFIGURATION)


def test_missing_opengl_is_told_with_the_package_to_install(monkeypatch):
    def import_module(name: str):
        raise OSError(f"lib for {name} not found")

    monkeypatch.setattr("pipeline.machine.offscreen.importlib.import_module", import_module)
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    with pytest.raises(InputError, match="apt install libegl1"):
        create_context(WIDTH, HEIGHT)
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    with pytest.raises(InputError, match="apt install libosmesa6"):
        create_context(WIDTH, HEIGHT)
    monkeypatch.setenv("MUJOCO_GL", "vulkan")
    with pytest.raises(InputError, match="MUJOCO_GL is 'vulkan'; set it to one of egl"):
        create_context(WIDTH, HEIGHT)
