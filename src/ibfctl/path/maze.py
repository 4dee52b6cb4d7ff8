"""Unicursal maze: a closed walk around a random spanning tree, without a preferred direction.

Cells of two by two nodes are joined by a random spanning tree; walking around the tree visits every node once,
in steps of one pitch along x or y (the idea of Wang, Wang and Xu 2015, Appl. Opt. 54, 10128).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.csgraph import connected_components, minimum_spanning_tree

from ibfctl.errors import InputError
from ibfctl.path.raster import MAX_NODES
from ibfctl.path.tool_path import ToolPath
from ibfctl.surface.map import Rectangle

# Nodes of a cell in walking order, as (row, column), and the neighbour towards which each may leave it.
_CORNERS = ((0, 0), (0, 1), (1, 1), (1, 0))
_EXITS = ((-1, 0), (0, 1), (1, 0), (0, -1))
_ARRIVALS = (3, 0, 1, 2)


def maze(area: Rectangle, pitch_mm: float, seed: int = 0, allowed: NDArray[np.bool_] | None = None) -> ToolPath:
    """Cover `area` with a maze.

    Parameters
    ----------
    area
        What the nodes must reach, the overrun included.
    pitch_mm
        Distance between neighbouring nodes.
    seed
        Of the random tree; the same seed gives the same path.
    allowed : (rows, columns) bool, optional
        Cells (two pitches wide, see `cell_centres`) that may be walked; all by default.

    Raises
    ------
    InputError
        If the allowed cells do not hang together.
    """
    x_mm, y_mm = cell_centres(area, pitch_mm)
    shape = (y_mm.size, x_mm.size)
    walkable = np.ones(shape, dtype=bool) if allowed is None else allowed
    nodes = _walk(_spanning_tree(walkable, np.random.default_rng(seed)), walkable)
    cell, corner = nodes // 4, nodes % 4
    offset = np.array(_CORNERS)[corner] - 0.5
    return ToolPath(x_mm[cell % shape[1]] + offset[:, 1] * pitch_mm, y_mm[cell // shape[1]] + offset[:, 0] * pitch_mm)


def cell_centres(area: Rectangle, pitch_mm: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres of the maze's cells along x and y: enough of them that their nodes reach the edges of `area`."""
    if not (math.isfinite(pitch_mm) and pitch_mm > 0):
        raise InputError(f"maze: pitch is {pitch_mm:g} mm, it must be positive", "correct --pitch-mm")
    counts = [
        max(2, math.ceil((high - low + pitch_mm) / (2 * pitch_mm) - 1e-9))
        for low, high in ((area.x0_mm, area.x1_mm), (area.y0_mm, area.y1_mm))
    ]
    if 4 * counts[0] * counts[1] > MAX_NODES:
        raise InputError(f"maze: pitch {pitch_mm:g} mm gives more than {MAX_NODES} nodes", "choose a larger pitch")
    middles = (0.5 * (area.x0_mm + area.x1_mm), 0.5 * (area.y0_mm + area.y1_mm))
    x_mm, y_mm = (
        np.asarray(middle + 2 * pitch_mm * (np.arange(n) - 0.5 * (n - 1)), dtype=np.float64)
        for middle, n in zip(middles, counts, strict=True)
    )
    return x_mm, y_mm


def _spanning_tree(walkable: NDArray[np.bool_], random: np.random.Generator) -> NDArray[np.bool_]:
    """Which of the four exits of each cell the tree uses, (cells, 4), in the order of `_EXITS`."""
    rows, columns = walkable.shape
    index = np.arange(rows * columns).reshape(rows, columns)
    east = walkable[:, :-1] & walkable[:, 1:]
    north = walkable[:-1] & walkable[1:]
    one = np.concatenate([index[:, :-1][east], index[:-1][north]])
    other = np.concatenate([index[:, 1:][east], index[1:][north]])
    graph = sparse.csr_array((1 + random.random(one.size), (one, other)), shape=(index.size, index.size))
    labels = connected_components(graph, directed=False)[1][walkable.ravel()]
    if labels.size == 0 or np.ptp(labels) > 0:
        raise InputError("maze: the region to cover is empty or falls into separate parts", "use a connected region")
    tree = minimum_spanning_tree(graph).tocoo()
    exits = np.zeros((index.size, 4), dtype=bool)
    is_north = np.abs(tree.col - tree.row) > 1 if columns > 1 else np.ones(tree.row.size, dtype=bool)
    low, high = np.minimum(tree.row, tree.col), np.maximum(tree.row, tree.col)
    exits[low[is_north], 2] = exits[high[is_north], 0] = True
    exits[low[~is_north], 1] = exits[high[~is_north], 3] = True
    return exits


def _walk(exits: NDArray[np.bool_], walkable: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Nodes (cell * 4 + corner) in the order of the walk around the tree, each once."""
    columns = walkable.shape[1]
    cell = np.arange(exits.shape[0])
    following = np.empty((cell.size, 4), dtype=np.int64)
    for corner, (row_step, column_step) in enumerate(_EXITS):
        inside = cell * 4 + (corner + 1) % 4
        across = (cell + row_step * columns + column_step) * 4 + _ARRIVALS[corner]
        following[:, corner] = np.where(exits[:, corner], across, inside)
    successor = following.ravel().tolist()
    node = int(np.flatnonzero(walkable.ravel())[0]) * 4
    order = np.empty(4 * int(walkable.sum()), dtype=np.int64)
    for place in range(order.size):
        order[place] = node
        node = successor[node]
    return order
