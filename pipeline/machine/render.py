"""Offscreen pictures and films of the arm, W+, the grill and a target pose, drawn by MuJoCo."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from types import TracebackType

import mujoco
import numpy as np
from PIL import Image

from pipeline.errors import InputError
from pipeline.machine.kinematics import Pose
from pipeline.machine.offscreen import create_context
from pipeline.machine.scene import Colour, build_scene
from pipeline.machine.specification import MachineSpecification
from pipeline.machine.workspace import workspace_of

TARGET_COLOUR: Colour = (0.05, 0.65, 0.35, 0.60)
AXIS_COLOURS: tuple[Colour, ...] = ((0.85, 0.2, 0.2, 1.0), (0.2, 0.7, 0.2, 1.0), (0.2, 0.35, 0.9, 1.0))
TRAIL_COLOUR: Colour = (0.80, 0.15, 0.45, 0.9)
BARREL_COLOUR: Colour = (0.16, 0.17, 0.19, 1.0)
ROD_COLOUR: Colour = (0.85, 0.87, 0.90, 1.0)

TARGET_CHISEL_LENGTH_M, TARGET_CHISEL_RADIUS_M = (
    0.26,
    0.02,
)  # the chisel's diameter is 0.04 m (paper, abstract)
TARGET_HAMMER_LENGTH_M, TARGET_HAMMER_RADIUS_M = 0.28, 0.07
AXIS_LENGTH_M, AXIS_RADIUS_M = 0.16, 0.008
TRAIL_RADIUS_M = 0.007
BARREL_RADIUS_M, ROD_RADIUS_M = 0.032, 0.016
TRAIL_SEGMENTS = 2000  # longer trails are thinned
DECORATIONS = TRAIL_SEGMENTS + 100  # room in MuJoCo's scene for trail, target and cylinders
CYLINDER_SWEEP = 33  # configurations on which a cylinder's shortest length is sought


@dataclass(frozen=True)
class View:
    """Where the camera stands: angles in degrees, distance in multiples of W+'s outer radius."""

    azimuth_deg: float
    elevation_deg: float
    distance: float


VIEWS = {
    "overview": View(azimuth_deg=128.0, elevation_deg=-20.0, distance=2.1),
    "side": View(azimuth_deg=90.0, elevation_deg=-6.0, distance=2.1),
    "top": View(azimuth_deg=90.0, elevation_deg=-89.0, distance=2.7),
}


class ArmRenderer:
    """Draws one machine. Holds an OpenGL context: use it in a `with` block."""

    def __init__(self, machine: MachineSpecification, directory: Path, width: int, height: int) -> None:
        """Builds the scene and its context.

        Args:
            machine: the machine, with arm and workspace.
            directory: where conf/machine lies.
            width: of the pictures, pixels.
            height: of the pictures, pixels.

        Raises:
            InputError: the machine cannot be drawn (`build_scene`) or OpenGL is missing (`create_context`).
        """
        self._model = build_scene(machine, Path(directory), width, height)
        self._data = mujoco.MjData(self._model)
        workspace = workspace_of(machine)
        self._reach = workspace.radius_max_m
        self._centre = np.array([0.36 * self._reach, 0.0, 0.40 * workspace.z_max_m])
        self._qpos_rows = [self._model.joint(name).qposadr[0] for name in machine.joint_names]
        self._cylinders = self._find_cylinders(machine)
        self._context = create_context(width, height)
        self._context.make_current()
        self._buffers = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._buffers)
        self._scene = mujoco.MjvScene(self._model, maxgeom=self._model.ngeom + DECORATIONS)
        self._rectangle = mujoco.MjrRect(0, 0, width, height)

    def __enter__(self) -> "ArmRenderer":
        """Returns the renderer; its context exists already."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Releases the context."""
        self.close()

    def close(self) -> None:
        """Releases the OpenGL context."""
        self._context.make_current()
        self._buffers.free()
        self._context.free()

    def frame(
        self,
        q: np.ndarray,
        target: Pose | None = None,
        trail: np.ndarray | None = None,
        view: str = "overview",
    ) -> np.ndarray:
        """Draws one configuration.

        Args:
            q: configuration, rad (m), shape (n_joint,).
            target: target pose in {B}, drawn as a chisel with its axes; None for none.
            trail: past positions of the chisel tip in {B}, m, shape (n, 3); None for none.
            view: a name in `VIEWS`.

        Returns:
            The picture, uint8, shape (height, width, 3).

        Raises:
            InputError: the view is unknown.
        """
        if view not in VIEWS:
            raise InputError(f"no view {view!r} of the machine; there are {', '.join(VIEWS)}")
        self._place(q)
        camera = mujoco.MjvCamera()
        camera.lookat = self._centre
        camera.azimuth, camera.elevation = VIEWS[view].azimuth_deg, VIEWS[view].elevation_deg
        camera.distance = VIEWS[view].distance * self._reach
        mujoco.mjv_updateScene(
            self._model,
            self._data,
            mujoco.MjvOption(),
            mujoco.MjvPerturb(),
            camera,
            mujoco.mjtCatBit.mjCAT_ALL,
            self._scene,
        )
        self._keep_workspace_from_casting_shadows()
        self._draw_cylinders()
        if trail is not None:
            self._draw_trail(np.asarray(trail, np.float64))
        if target is not None:
            self._draw_target(target)
        self._context.make_current()
        mujoco.mjr_render(self._rectangle, self._scene, self._buffers)
        picture = np.empty((self._rectangle.height, self._rectangle.width, 3), np.uint8)
        mujoco.mjr_readPixels(picture, None, self._rectangle, self._buffers)
        return picture[::-1].copy()  # OpenGL's first row is the lowest

    def _keep_workspace_from_casting_shadows(self) -> None:
        """Redraws translucent shapes as decoration: MuJoCo lets them cast full shadows otherwise."""
        for geom in self._scene.geoms[: self._scene.ngeom]:
            if geom.rgba[3] < 1.0:
                geom.category = mujoco.mjtCatBit.mjCAT_DECOR

    def _place(self, q: np.ndarray) -> None:
        self._data.qpos[self._qpos_rows] = np.asarray(q, np.float64)
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)

    def _connect(
        self, start: np.ndarray, stop: np.ndarray, radius: float, colour: Colour, shape: int
    ) -> None:
        geom = self._scene.geoms[self._scene.ngeom]
        mujoco.mjv_initGeom(
            geom, shape, np.zeros(3), np.zeros(3), np.eye(3).ravel(), np.array(colour, np.float32)
        )
        mujoco.mjv_connector(geom, shape, radius, start, stop)
        self._scene.ngeom += 1

    def _find_cylinders(self, machine: MachineSpecification) -> list[tuple[int, int, float]]:
        """Pairs of frames <name>_cylinder_barrel and <name>_cylinder_rod, and the barrel's length.

        The barrel is as long as the cylinder at its shortest. Each cylinder spans one joint, so sweeping all
        joints together meets every cylinder's shortest length.
        """
        bodies = {self._model.body(i).name: i for i in range(self._model.nbody)}
        suffix = "_cylinder_barrel"
        names = sorted(name.removesuffix(suffix) for name in bodies if name.endswith(suffix))
        names = [name for name in names if f"{name}_cylinder_rod" in bodies]
        pairs = [(bodies[name + suffix], bodies[f"{name}_cylinder_rod"]) for name in names]
        shortest = np.full(len(pairs), np.inf)
        for q in np.linspace(machine.lower, machine.upper, CYLINDER_SWEEP):
            self._place(q)
            lengths = [
                np.linalg.norm(self._data.xpos[rod] - self._data.xpos[barrel]) for barrel, rod in pairs
            ]
            shortest = np.minimum(shortest, lengths)
        return [(barrel, rod, length) for (barrel, rod), length in zip(pairs, shortest, strict=True)]

    def _draw_cylinders(self) -> None:
        for barrel, rod, length in self._cylinders:
            start, stop = self._data.xpos[barrel], self._data.xpos[rod]
            direction = (stop - start) / np.linalg.norm(stop - start)
            shape = mujoco.mjtGeom.mjGEOM_CYLINDER
            self._connect(start, start + length * direction, BARREL_RADIUS_M, BARREL_COLOUR, shape)
            self._connect(start, stop, ROD_RADIUS_M, ROD_COLOUR, shape)

    def _draw_trail(self, trail: np.ndarray) -> None:
        stride = 1 + len(trail) // TRAIL_SEGMENTS
        for start, stop in pairwise(trail[::stride]):
            self._connect(start, stop, TRAIL_RADIUS_M, TRAIL_COLOUR, mujoco.mjtGeom.mjGEOM_CAPSULE)

    def _draw_target(self, target: Pose) -> None:
        position = np.asarray(target.position, np.float64)
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, np.asarray(target.quaternion, np.float64))
        columns = axes.reshape(3, 3).T
        # a ghost of hammer and chisel; the chisel points along -z of its frame
        shoulder = position + TARGET_CHISEL_LENGTH_M * columns[2]
        top = shoulder + TARGET_HAMMER_LENGTH_M * columns[2]
        shape = mujoco.mjtGeom.mjGEOM_CYLINDER
        self._connect(position, shoulder, TARGET_CHISEL_RADIUS_M, TARGET_COLOUR, shape)
        self._connect(shoulder, top, TARGET_HAMMER_RADIUS_M, TARGET_COLOUR, shape)
        for column, colour in zip(columns, AXIS_COLOURS, strict=True):
            end = position + AXIS_LENGTH_M * column
            self._connect(position, end, AXIS_RADIUS_M, colour, mujoco.mjtGeom.mjGEOM_CYLINDER)


def render_frame(
    machine: MachineSpecification,
    directory: Path,
    q: np.ndarray,
    target: Pose | None = None,
    width: int = 960,
    height: int = 720,
    view: str = "overview",
) -> np.ndarray:
    """Draws one configuration; see `ArmRenderer.frame`.

    Returns:
        The picture, uint8, shape (height, width, 3).

    Raises:
        InputError: the machine cannot be drawn, OpenGL is missing, or the view is unknown.
    """
    with ArmRenderer(machine, directory, width, height) as renderer:
        return renderer.frame(q, target, view=view)


def save_film(pictures: Sequence[np.ndarray], path: Path, frames_per_second: float) -> None:
    """Writes pictures as a looping animation, WebP or GIF by the path's suffix.

    Args:
        pictures: uint8, shape (height, width, 3) each.
        path: ends in .webp or .gif.
        frames_per_second: of the animation.

    Raises:
        InputError: `pictures` is empty, or the suffix is neither.
    """
    if not pictures:
        raise InputError(f"{path}: no picture to write; give at least one configuration")
    if path.suffix not in (".webp", ".gif"):
        raise InputError(f"{path}: films are written as .webp or .gif; choose one of these suffixes")
    images = [Image.fromarray(picture) for picture in pictures]
    duration_ms = round(1000.0 / frames_per_second)
    images[0].save(path, save_all=True, append_images=images[1:], duration=duration_ms, loop=0)


def render_film(
    machine: MachineSpecification,
    directory: Path,
    configurations: np.ndarray,
    targets: Sequence[Pose | None],
    positions: np.ndarray,
    width: int = 640,
    height: int = 480,
    view: str = "overview",
) -> list[np.ndarray]:
    """Draws a motion, with the path of the chisel tip so far.

    Args:
        directory: where conf/machine lies.
        configurations: rad (m), shape (T, n_joint).
        targets: target pose at each of the T steps, or None.
        positions: of the chisel tip at each step in {B}, m, shape (T, 3).
        width: pixels.
        height: pixels.
        view: a name in `VIEWS`.

    Returns:
        T pictures, uint8, shape (height, width, 3); `save_film` writes them.

    Raises:
        InputError: the machine cannot be drawn, OpenGL is missing, or the view is unknown.
    """
    with ArmRenderer(machine, directory, width, height) as renderer:
        return [
            renderer.frame(q, target, trail=positions[: step + 1], view=view)
            for step, (q, target) in enumerate(zip(configurations, targets, strict=True))
        ]
