"""The MuJoCo model that renderings show: the arm, the restricted workspace W+, the grill and the ground.

Nothing here is simulated; MuJoCo only places and draws the bodies (paper, figure of the rendered
environment).
"""

from itertools import pairwise
from pathlib import Path

import mujoco
import numpy as np

from pipeline.machine.chain import urdf_path
from pipeline.machine.description import compile_urdf, read_urdf
from pipeline.machine.sector import sector_edges, sector_surface
from pipeline.machine.specification import MachineSpecification, WorkspaceSpecification
from pipeline.machine.workspace import workspace_of

Colour = tuple[float, float, float, float]  # red, green, blue, opacity in [0, 1]

WORKSPACE_COLOUR: Colour = (0.10, 0.50, 0.95, 0.11)
WORKSPACE_EDGE_COLOUR: Colour = (0.13, 0.42, 0.72, 0.85)
GRILL_COLOUR: Colour = (0.45, 0.42, 0.40, 1.0)
PIT_COLOUR: Colour = (0.10, 0.09, 0.09, 1.0)
GROUND_COLOURS = ((0.74, 0.72, 0.68), (0.71, 0.69, 0.65))
SKY_COLOURS = ((0.80, 0.88, 0.95), (0.90, 0.93, 0.95))

EDGE_RADIUS_M = 0.006
GRILL_BAR_SPACING_M = 0.26
GRILL_BAR_WIDTH_M = 0.045
PIT_HEIGHT_M = 0.02  # enough above the ground to cover it
GROUND_HALF_SIZE_M = 40.0
CHECKER_PER_M = 0.5  # a texture holds two by two squares: one square is a metre
SHADOW_MAP_PIXELS = 4096
SAMPLES_PER_PIXEL = 4


def build_scene(machine: MachineSpecification, directory: Path, width: int, height: int) -> mujoco.MjModel:
    """Builds the model to be rendered.

    Args:
        machine: the machine, with arm and workspace.
        directory: where conf/machine lies.
        width: of the largest picture, pixels.
        height: of the largest picture, pixels.

    Returns:
        A model whose joints bear the machine's joint names and whose fixed frames are kept as bodies.

    Raises:
        InputError: the machine lacks arm or workspace, or its URDF is missing or unreadable.
    """
    workspace = workspace_of(machine)
    path = urdf_path(machine, directory)
    scene = read_urdf(path)
    scene.compiler.fusestatic = False
    scene.visual.global_.offwidth = width
    scene.visual.global_.offheight = height
    scene.visual.quality.shadowsize = SHADOW_MAP_PIXELS
    scene.visual.quality.offsamples = SAMPLES_PER_PIXEL
    scene.stat.extent = workspace.radius_max_m  # near and far planes and shadows are scaled by it
    _add_light(scene)
    _add_ground(scene)
    _add_grill(scene, workspace)
    _add_workspace(scene, workspace)
    return compile_urdf(scene, path)


def _add_light(scene: mujoco.MjSpec) -> None:
    scene.visual.headlight.ambient = (0.38, 0.38, 0.40)
    scene.visual.headlight.diffuse = (0.28, 0.28, 0.28)
    scene.visual.headlight.specular = (0.05, 0.05, 0.05)
    scene.visual.map.shadowclip = 4.0
    scene.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=(-1.0, -4.0, 6.0),
        dir=(0.45, 0.45, -1.0),
        diffuse=(0.62, 0.60, 0.56),
        specular=(0.05, 0.05, 0.05),
        castshadow=True,
    )


def _add_ground(scene: mujoco.MjSpec) -> None:
    scene.add_texture(
        name="sky",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=SKY_COLOURS[0],
        rgb2=SKY_COLOURS[1],
        width=256,
        height=256,
    )
    scene.add_texture(
        name="ground",
        type=mujoco.mjtTexture.mjTEXTURE_2D,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=GROUND_COLOURS[0],
        rgb2=GROUND_COLOURS[1],
        width=256,
        height=256,
    )
    material = scene.add_material(name="ground", texrepeat=(CHECKER_PER_M, CHECKER_PER_M), texuniform=True)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "ground"
    scene.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=(GROUND_HALF_SIZE_M, GROUND_HALF_SIZE_M, 1.0),
        material="ground",
        contype=0,
        conaffinity=0,
    )


def _add_box(scene: mujoco.MjSpec, centre: tuple[float, float, float], size: tuple, colour: Colour) -> None:
    scene.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        pos=centre,
        size=[0.5 * extent for extent in size],
        rgba=colour,
        contype=0,
        conaffinity=0,
    )


def _add_grill(scene: mujoco.MjSpec, workspace: WorkspaceSpecification) -> None:
    """A square steel grate over a dark pit, under the middle of W+, its top at the grill's height."""
    side = workspace.radius_max_m - workspace.radius_min_m
    middle = 0.5 * (workspace.radius_max_m + workspace.radius_min_m)
    top = workspace.grill_height_m
    bar_height = 0.5 * top
    _add_box(scene, (middle, 0.0, 0.5 * PIT_HEIGHT_M), (side, side, PIT_HEIGHT_M), PIT_COLOUR)
    offsets = np.linspace(-0.5 * side, 0.5 * side, round(side / GRILL_BAR_SPACING_M) + 1)
    across, along = (GRILL_BAR_WIDTH_M, side, bar_height), (side, GRILL_BAR_WIDTH_M, bar_height)
    for offset in offsets:
        _add_box(scene, (middle + offset, 0.0, top - 0.5 * bar_height), across, GRILL_COLOUR)
        _add_box(scene, (middle, offset, top - 0.6 * bar_height), along, GRILL_COLOUR)
    for x in (-0.5 * side, 0.5 * side):
        for y in (-0.5 * side, 0.5 * side):
            feet = (2.0 * GRILL_BAR_WIDTH_M, 2.0 * GRILL_BAR_WIDTH_M, top)
            _add_box(scene, (middle + x, y, 0.5 * top), feet, GRILL_COLOUR)


def _add_workspace(scene: mujoco.MjSpec, workspace: WorkspaceSpecification) -> None:
    """W+ as a translucent cylindrical sector with drawn edges."""
    vertices, triangles = sector_surface(workspace)
    scene.add_mesh(
        name="workspace",
        uservert=vertices.ravel(),
        userface=triangles.ravel(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    scene.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname="workspace",
        rgba=WORKSPACE_COLOUR,
        contype=0,
        conaffinity=0,
    )
    for edge in sector_edges(workspace):
        for start, stop in pairwise(edge):
            scene.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_CAPSULE,
                fromto=(*start, *stop),
                size=(EDGE_RADIUS_M, 0.0, 0.0),
                rgba=WORKSPACE_EDGE_COLOUR,
                contype=0,
                conaffinity=0,
            )
