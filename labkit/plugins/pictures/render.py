"""Shaded images of spheres and sticks: exact surfaces in orthographic projection, so that lengths are to scale.

A canvas stores the nearest surface at every pixel. Light comes from the upper left; gaps between objects are darker.
Rendering needs no display and no graphics library, and repeated renderings are bitwise identical.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.ndimage import gaussian_filter

FINE = 2  # pixels of the canvas per pixel of the image, along each side
LIGHT = np.array([-0.45, 0.55, 0.70])  # components to the right, up and towards the viewer
AMBIENT, DIFFUSE, GLOSS = 0.50, 0.60, 0.10
SHADE = 1.7  # strength of the darkening in gaps


@dataclasses.dataclass(frozen=True, eq=False)
class Canvas:
    """Nearest surface at every pixel.

    Args:
        view: Rows that point to the right, up, and towards the viewer, (3, 3).
        corner: Lower left corner of the image, (2,).
        pixel: Size of a pixel, in the unit of `corner`.
        depth: Position along the line of sight, greater is nearer, -inf without a surface, (rows, columns).
        normal: Normal of the surface, (rows, columns, 3).
        color: Colour of the surface, (rows, columns, 3).
    """

    view: np.ndarray
    corner: np.ndarray
    pixel: float
    depth: np.ndarray
    normal: np.ndarray
    color: np.ndarray


def canvas(view: np.ndarray, low: np.ndarray, high: np.ndarray, width: int) -> Canvas:
    """Return an empty Canvas, `width` pixels wide, from `low` to `high` (2,): coordinates to the right and up."""
    pixel = (high[0] - low[0]) / (FINE * width)
    rows = FINE * round((high[1] - low[1]) / (FINE * pixel))
    shape = rows, FINE * width
    return Canvas(view, np.asarray(low), pixel, np.full(shape, -np.inf), np.zeros((*shape, 3)), np.zeros((*shape, 3)))


def draw_spheres(on: Canvas, centre: np.ndarray, radius: np.ndarray, color: np.ndarray) -> None:
    """Draw spheres: centre (n, 3), radius (n,), and color (n, 3): red, green and blue from 0 to 1."""
    draw_sticks(on, centre, centre, radius, color)


def draw_sticks(on: Canvas, start: np.ndarray, end: np.ndarray, radius: np.ndarray, color: np.ndarray) -> None:
    """Draw round sticks with round ends: start, end (n, 3), radius (n,), color (n, 3). The length may be zero."""
    start, end = start @ on.view.T, end @ on.view.T
    low = ((np.minimum(start, end)[:, :2] - radius[:, None] - on.corner) / on.pixel).astype(int)
    high = ((np.maximum(start, end)[:, :2] + radius[:, None] - on.corner) / on.pixel).astype(int)
    low, high = np.maximum(low, 0), np.minimum(high + 1, on.depth.shape[::-1])
    length = np.linalg.norm(end - start, axis=1)
    axis = (end - start) / np.maximum(length, 1e-300)[:, None]
    for k in np.flatnonzero((low < high).all(axis=1)):  # only the pixels that the stick may cover
        (first, bottom), (last, top), r = low[k], high[k], radius[k]
        part = slice(bottom, top), slice(first, last)
        u = (on.corner[0] + (np.arange(first, last) + 0.5) * on.pixel - start[k, 0])[None, :]
        v = (on.corner[1] + (np.arange(bottom, top) + 0.5) * on.pixel - start[k, 1])[:, None]
        height, along = _stick_surface(u, v, axis[k], length[k], r)
        seen = start[k, 2] + height > on.depth[part]
        surface = np.stack(np.broadcast_arrays(u, v, height), axis=-1)[seen]
        on.depth[part][seen] = start[k, 2] + height[seen]
        on.normal[part][seen] = (surface - along[seen, None] * axis[k]) / r
        on.color[part][seen] = color[k]


def haze(on: Canvas, cell: np.ndarray, length: float) -> np.ndarray:
    """Return the degree to which each pixel fades to white, (rows, columns), 0 to 1.

    A pixel fades with its depth behind the faces of a cell at the origin.

    Args:
        on: The canvas.
        cell: Cell vectors as columns, (3, 3).
        length: Depth over which two thirds of the colour fade.
    """
    rows, columns = on.depth.shape
    x, y = (on.corner[k] + on.pixel * (np.arange(n) + 0.5) for k, n in ((0, columns), (1, rows)))
    near = np.full((rows, columns), np.inf)
    for row in np.linalg.inv(on.view @ cell):  # maps view coordinates to cell coordinates, 0 to 1 inside
        if abs(row[2]) > 1e-9 * np.linalg.norm(row):  # the line of sight is not parallel to this pair of faces
            periods = row[0] * x[None, :] + row[1] * y[:, None]
            near = np.minimum(near, ((row[2] > 0.0) - periods) / row[2])
    behind = np.where(np.isfinite(on.depth), near - on.depth, 0.0)
    return 1.0 - np.exp(-np.clip(behind, 0.0, None) / length)


def shade(on: Canvas, reach: float, white: np.ndarray | float = 0.0) -> np.ndarray:
    """Return an image (rows, columns, 4): red, green, blue and opacity, 0 to 1, first row at the bottom.

    `reach` is the range of the ambient occlusion between neighbouring objects; `white`, 0 to 1, is the result of
    `haze`.
    """
    light = LIGHT / np.linalg.norm(LIGHT)
    halfway = (light + np.array([0.0, 0.0, 1.0])) / np.linalg.norm(light + np.array([0.0, 0.0, 1.0]))
    bright = AMBIENT + DIFFUSE * np.clip(on.normal @ light, 0.0, None)
    gloss = GLOSS * np.clip(on.normal @ halfway, 0.0, None) ** 30
    color = np.clip(on.color * (bright * _open_sky(on, reach))[..., None] + gloss[..., None], 0.0, 1.0)
    color += (1.0 - color) * np.reshape(white, (*np.shape(white), 1))
    opacity = np.isfinite(on.depth)[..., None]
    image = np.concatenate([color * opacity, opacity], axis=-1)
    rows, columns = on.depth.shape
    image = image.reshape(rows // FINE, FINE, columns // FINE, FINE, 4).mean(axis=(1, 3))
    image[..., :3] /= np.maximum(image[..., 3:], 1e-9)
    return np.clip(image, 0.0, 1.0)


def _open_sky(on: Canvas, reach: float) -> np.ndarray:
    """Return the fraction of ambient light that reaches each pixel: less where both sides are higher.

    Opposite sides are averaged, so that a plain slope is not darkened by its upper side.
    """
    number = 12  # sampled neighbours, arranged in a sunflower spiral
    angle, far = 2.4 * np.arange(number), reach / on.pixel * np.sqrt((np.arange(number) + 0.5) / number)
    steps = np.rint(far[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)).astype(int)
    lower = gaussian_filter(_lower(on.depth, steps, reach), FINE, mode="nearest", truncate=2.0)
    return np.exp(-SHADE * lower / (number * reach))


def _lower(depth: np.ndarray, steps: np.ndarray, most: float) -> np.ndarray:
    """Return the depth of each pixel below the mean of two opposite neighbours, at most `most`, summed over `steps`."""
    rows, columns = depth.shape
    lower = np.zeros((rows, columns))
    for a, b in steps.tolist():
        m, n = abs(a), abs(b)
        if 2 * m >= rows or 2 * n >= columns:
            continue
        inner = slice(m, rows - m), slice(n, columns - n)
        shifted = depth[m + a : rows - m + a, n + b : columns - n + b]
        other = depth[m - a : rows - m - a, n - b : columns - n - b]
        with np.errstate(invalid="ignore"):  # depths are -inf where nothing is drawn
            below = 0.5 * (shifted + other) - depth[inner]
        lower[inner] += np.where((below > 0.0) & (below < np.inf), np.minimum(below, most), 0.0)
    return lower


def _stick_surface(
    u: np.ndarray, v: np.ndarray, axis: np.ndarray, length: float, r: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return height of the surface at (u, v) above the start, -inf outside the stick, and distance along the axis.

    The surface is the highest point of spheres along the axis, t axis_z + sqrt(r^2 - |(u, v) - t (axis_x, axis_y)|^2).
    """
    a, w = max(1.0 - axis[2] ** 2, 1e-12), u * axis[0] + v * axis[1]
    inside = np.maximum(r * r - u * u - v * v + w * w / a, 0.0)
    along = np.clip(w / a + axis[2] * np.sqrt(inside / a), 0.0, length)
    square = r * r - (u - along * axis[0]) ** 2 - (v - along * axis[1]) ** 2
    return np.where(square >= 0.0, along * axis[2] + np.sqrt(np.maximum(square, 0.0)), -np.inf), along
