"""The shape of W+, a cylindrical sector, for drawing: its edges and its surface."""

import numpy as np

from pipeline.machine.specification import WorkspaceSpecification

ARC_SEGMENTS = 24


def sector_edges(workspace: WorkspaceSpecification) -> list[np.ndarray]:
    """The twelve edges of W+ in {B}: four arcs, four uprights, four radii; each a polyline (n, 3), m."""
    arcs = _arcs(workspace)
    edges = list(arcs.values())
    for end in (0, -1):
        for side in ("inner", "outer"):
            edges.append(np.stack([arcs[side, "bottom"][end], arcs[side, "top"][end]]))
        for level in ("bottom", "top"):
            edges.append(np.stack([arcs["inner", level][end], arcs["outer", level][end]]))
    return edges


def sector_surface(workspace: WorkspaceSpecification) -> tuple[np.ndarray, np.ndarray]:
    """The closed surface of W+ in {B}.

    Args:
        workspace: bounds of W+.

    Returns:
        Vertices, shape (n, 3), m, and triangles, shape (m, 3), of indices anticlockwise as seen from outside.
        The six faces share no vertices, so that shading keeps their edges sharp.
    """
    arcs = _arcs(workspace)
    right = {side: [arcs[side, level][:1] for level in ("bottom", "top")] for side in ("inner", "outer")}
    left = {side: [arcs[side, level][-1:] for level in ("bottom", "top")] for side in ("inner", "outer")}
    faces = [  # each the strip between two polylines, its front outside
        (arcs["outer", "bottom"], arcs["outer", "top"]),
        (arcs["inner", "top"], arcs["inner", "bottom"]),
        (arcs["outer", "top"], arcs["inner", "top"]),
        (arcs["inner", "bottom"], arcs["outer", "bottom"]),
        (np.concatenate(right["outer"]), np.concatenate(right["inner"])),
        (np.concatenate(left["inner"]), np.concatenate(left["outer"])),
    ]
    vertices: list[np.ndarray] = []
    triangles: list[np.ndarray] = []
    n_vertices = 0
    for first, second in faces:
        n = len(first)
        i = n_vertices + np.arange(n - 1)
        triangles += [np.stack([i, i + 1, n + i], axis=1), np.stack([i + 1, n + i + 1, n + i], axis=1)]
        vertices += [first, second]
        n_vertices += 2 * n
    return np.concatenate(vertices), np.concatenate(triangles)


def _arcs(workspace: WorkspaceSpecification) -> dict[tuple[str, str], np.ndarray]:
    """The four arcs of the boundary from right to left, each (ARC_SEGMENTS + 1, 3)."""
    yaw = np.linspace(-workspace.yaw_max_rad, workspace.yaw_max_rad, ARC_SEGMENTS + 1)
    radii = {"inner": workspace.radius_min_m, "outer": workspace.radius_max_m}
    heights = {"bottom": workspace.z_min_m, "top": workspace.z_max_m}
    return {
        (side, level): np.stack([radius * np.cos(yaw), radius * np.sin(yaw), np.full_like(yaw, z)], axis=1)
        for side, radius in radii.items()
        for level, z in heights.items()
    }
