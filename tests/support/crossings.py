"""Whether a path crosses or touches itself, every segment against every other."""

import numpy as np

from ibfctl.path.tool_path import ToolPath


def crossings(path: ToolPath) -> int:
    """Count pairs of segments that meet, neighbours at their common node left out; folds back count as well."""
    nodes = np.column_stack([path.x_mm, path.y_mm])
    start, end = nodes[:-1], nodes[1:]
    move = end - start

    def side(points: np.ndarray) -> np.ndarray:
        """Side of each segment's line (rows) on which each point (columns) lies."""
        off = points[None] - start[:, None]
        return np.sign(move[:, None, 0] * off[..., 1] - move[:, None, 1] * off[..., 0])

    apart = side(start) * side(end)
    meets = (apart <= 0) & (apart.T <= 0)
    # On one line, segments meet only where they overlap along it.
    low, high = np.minimum(start, end), np.maximum(start, end)
    boxes = ((low[:, None] <= high[None]) & (low[None] <= high[:, None])).all(axis=2)
    count = int(np.triu(meets & boxes, 2).sum())
    along = (move[1:] * move[:-1]).sum(axis=1)
    across = move[:-1, 0] * move[1:, 1] - move[:-1, 1] * move[1:, 0]
    return count + int(((along < 0) & (np.abs(across) <= 1e-12 * np.abs(along))).sum())
