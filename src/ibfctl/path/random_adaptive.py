"""Random adaptive path: turns by random angles, never crosses itself, and is denser where more is to be removed.

The properties of the path of Negi et al. 2022 (Opt. Express 30, 29295), by another construction. Scattered points
whose distance follows the local pitch are joined to triangles; a random spanning tree joins neighbouring triangles; the
path walks around that tree, as a maze does around its tree of cells. Each triangle holds three nodes, one
towards each corner, and the path goes from one to the next: inside a triangle, or, where the tree leads on, across the
edge to the neighbour's node at the same corner. It cannot cross itself: what runs along an edge stays on its side of
the line between the nodes and that edge, and the two steps across an edge pass on either side of its middle.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree
from scipy.spatial import Delaunay

from ibfctl.errors import InputError
from ibfctl.path.scatter import Field, scatter
from ibfctl.path.tool_path import ToolPath

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# Distance of scattered points per pitch: as many nodes as a maze of that pitch has.
POINTS_DISTANCE = 1.98
# Lattice places per smallest distance of points.
LATTICE_PER_DISTANCE = 4
# Weight of a node's own corner, the rest shared by the others: equal steps inside and across in equal triangles.
_OWN_CORNER = (3 + np.sqrt(3)) / (3 + 3 * np.sqrt(3))
# Where on an edge, from the corner it belongs to, a step may cross.
_CROSSING = (0.02, 0.48)
# So many triangles that no other joins are a crumb at the rim, and left out.
_CRUMB = 3


def random_adaptive(pitch_mm: Field, needed: Field, seed: int) -> ToolPath:
    """Cover a region with a random path of varying pitch.

    Parameters
    ----------
    pitch_mm
        Local distance of the path from itself, wherever points may lie: the region and about three pitches around it.
    needed
        1 where the path must go, NaN elsewhere.
    seed
        Of points and tree; the same seed gives the same path.

    Raises
    ------
    InputError
        If the region falls into separate parts.
    """
    random = np.random.default_rng(seed)
    distance_mm = Field(POINTS_DISTANCE * pitch_mm.values, pitch_mm.lattice_mm, pitch_mm.x0_mm, pitch_mm.y0_mm)
    mesh = Delaunay(scatter(distance_mm, random))
    corners = mesh.points[mesh.simplices]
    kept = np.isfinite(needed.at(*corners.mean(axis=1).T))
    triangles, neighbours = _largest_part(mesh.simplices[kept].astype(np.int64), _renumbered(mesh.neighbors, kept))
    across = _walked_edges(neighbours, random)
    order, crossing = _walk(triangles, neighbours, across)
    return _laid(mesh.points, triangles, order, crossing)


def _renumbered(neighbours: NDArray[np.int32], kept: NDArray[np.bool_]) -> IntArray:
    """Neighbours (m, 3) of the kept triangles, counted among them; -1 for none."""
    number = np.append(np.where(kept, np.cumsum(kept) - 1, -1), -1)
    return np.asarray(number[neighbours[kept]], dtype=np.int64)


def _largest_part(triangles: IntArray, neighbours: IntArray) -> tuple[IntArray, IntArray]:
    """Drop crumbs at the rim that no neighbour joins; refuse a region of several parts."""
    one, corner = np.nonzero(neighbours >= 0)
    graph = sparse.csr_array((np.ones(one.size), (one, neighbours[one, corner])), shape=(len(triangles),) * 2)
    count, label = connected_components(graph, directed=False) if len(triangles) else (0, np.zeros(0, dtype=np.int64))
    sizes = np.bincount(label, minlength=1)
    if not count or (np.sort(sizes)[:-1] > _CRUMB).any():
        raise InputError(
            "random path: the region to cover is empty or falls into separate parts", "use a connected region"
        )
    kept = label == int(np.argmax(sizes))
    return triangles[kept], _renumbered(neighbours.astype(np.int32), kept)


def _walked_edges(neighbours: IntArray, random: np.random.Generator) -> NDArray[np.bool_]:
    """Edges (m, 3), each opposite its corner, that a random spanning tree of the triangles leads across."""
    count = len(neighbours)
    one, corner = np.nonzero(neighbours > np.arange(count)[:, None])
    other = neighbours[one, corner]
    graph = sparse.csr_array((1 + random.random(one.size), (one, other)), shape=(count, count))
    tree = minimum_spanning_tree(graph).tocoo()
    led = np.minimum(tree.row, tree.col) * np.int64(count) + np.maximum(tree.row, tree.col)
    walked = np.zeros(neighbours.shape, dtype=bool)
    walked[one, corner] = np.isin(one * count + other, led)
    walked[other, np.argmax(neighbours[other] == one[:, None], axis=1)] = walked[one, corner]
    return walked


def _walk(triangles: IntArray, neighbours: IntArray, across: NDArray[np.bool_]) -> tuple[IntArray, NDArray[np.bool_]]:
    """Nodes (triangle * 3 + corner) in the order of the walk, and whether the step after each leads across an edge."""
    following = np.empty(triangles.shape, dtype=np.int64)
    leads = np.empty(triangles.shape, dtype=bool)
    own = np.arange(len(triangles))
    for corner in range(3):
        # Corners go around counterclockwise: the step to the next one runs along the edge opposite the third.
        edge = (corner + 2) % 3
        leads[:, corner] = across[:, edge]
        there = neighbours[:, edge]
        same = np.argmax(triangles[there] == triangles[:, corner, None], axis=1)
        following[:, corner] = np.where(across[:, edge], 3 * there + same, 3 * own + (corner + 1) % 3)
    successor = following.ravel().tolist()
    order = np.empty(triangles.size, dtype=np.int64)
    node = 0
    for place in range(order.size):
        order[place] = node
        node = successor[node]
    return order, leads.ravel()[order]


def _laid(points_mm: FloatArray, triangles: IntArray, order: IntArray, crossing: NDArray[np.bool_]) -> ToolPath:
    """Positions of the nodes, and of crossings of edges where the straight step would pass them by."""
    corners = points_mm[triangles]
    shared = 0.5 * (1 - _OWN_CORNER)
    nodes = ((_OWN_CORNER - shared) * corners + shared * corners.sum(axis=1, keepdims=True)).reshape(-1, 2)
    steps = np.flatnonzero(crossing[:-1])
    here, there = nodes[order[steps]], nodes[order[steps + 1]]
    triangle, corner = np.divmod(order[steps], 3)
    own, end = corners[triangle, corner], corners[triangle, (corner + 1) % 3]
    along = end - own
    square = (along**2).sum(axis=1)
    off_here, off_there = (_cross(along, place - own) for place in (here, there))
    middle = here + (off_here / (off_here - off_there))[:, None] * (there - here)
    share = ((middle - own) * along).sum(axis=1) / square
    clipped = np.clip(share, *_CROSSING)
    bent = clipped != share
    extra = own[bent] + clipped[bent, None] * along[bent]
    path = np.insert(nodes[order], steps[bent] + 1, extra, axis=0)
    return ToolPath(path[:, 0].copy(), path[:, 1].copy())


def _cross(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])
