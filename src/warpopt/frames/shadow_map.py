"""A shadow map read through its matrix: biases, filters, and the texels that pixels read."""

import dataclasses
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float
from scipy import ndimage

from .._words import one_of
from .light_rays import LitScene
from .seen import Frame

Bias = Literal["slope", "constant", "plane", "second_depth", "back_faces"]
Filter = Literal["nearest", "pcf2", "pcf3", "eye_blur", "eye_blur_depth"]
BIASES: tuple[str, ...] = ("slope", "constant", "plane", "second_depth", "back_faces")
FILTERS: tuple[str, ...] = ("nearest", "pcf2", "pcf3", "eye_blur", "eye_blur_depth")
_TAPS = {"nearest": 1, "pcf2": 2, "pcf3": 3}
_NEAREST = 0.02  # share of the pixels that are nearer than where the blur begins to narrow


@dataclasses.dataclass(frozen=True)
class Reading:
    """How a map is read.

    Args:
        filter: "nearest"; "pcf2" and "pcf3", the mean verdict of 2x2 (bilinear) and 3x3 texels; "eye_blur",
            the image of 2x2 verdicts, blurred on the screen (SC 4.3), and "eye_blur_depth", the same with a width that
            falls as 1/z.
        bias: "slope", `amount` texels of the receiver's slope (the larger of both axes, as graphics interfaces have
            it); "constant", `amount` times the depth range of the map; "plane", the receiver's plane at the texel's
            centre and `amount` texels of slope; "second_depth", the middle between the first two surfaces;
            "back_faces", the first surface that turns its back to the light. The last two use `amount` as "slope".
        amount: None for the default: one texel for nearest, two for 2x2 and three for 3x3, twice the distance on each
            axis of the farthest texel's centre that is read; a tenth for plane, second depth and back faces; 0.002 of
            the depth range for "constant".
        warped_depth: compare and bias the map's depth z/w, in which the warp divides by A, and not the distance.
        blur_pixels: width of a blur, two standard deviations; with depth, that of the nearest pixels.

    Raises:
        ValueError: an unknown word, or an amount that is not a number >= 0.

    Example:
        >>> Reading("pcf3").texels
        3.0
    """

    filter: Filter = "nearest"
    bias: Bias = "slope"
    amount: float | None = None
    warped_depth: bool = False
    blur_pixels: float = 3.0

    def __post_init__(self):
        one_of("filter", self.filter, FILTERS)
        one_of("bias", self.bias, BIASES)
        if self.amount is not None and not 0 <= self.amount < np.inf:
            raise ValueError(f"amount: got {self.amount}, expected a finite number >= 0")
        if not 0 < self.blur_pixels < np.inf:
            raise ValueError(f"blur_pixels: got {self.blur_pixels}, expected a finite number > 0")

    @property
    def blurs(self) -> bool:
        """Whether pixels read their neighbours' verdicts."""
        return self.filter.startswith("eye_blur")

    @property
    def sharp(self) -> "Reading":
        """Of the image that a blur smooths: 2x2 verdicts."""
        return dataclasses.replace(self, filter="pcf2")

    @property
    def texels(self) -> float:
        """The bias: texels of slope, or the share of the map's depth range for "constant"."""
        if self.amount is not None:
            return self.amount
        if self.bias == "constant":
            return 0.002
        if self.bias != "slope":
            return 0.1
        return {"nearest": 1.0, "pcf3": 3.0}.get(self.filter, 2.0)


class ShadowMap:
    """A shadow map of a scene: `shadow_matrix` and a size. Texels are traced where they are read, never stored.

    Args:
        scene: what casts shadows.
        matrix: (4, 4) world to clip space, OpenGL's convention, for column vectors.
        size: texels along (t, s).

    Raises:
        ValueError: a matrix of another shape, not finite, or under which light rays are not lines of constant (t, s).
    """

    def __init__(self, scene: LitScene, matrix: Float[np.ndarray, "4 4"], size: tuple[int, int]):
        matrix = np.asarray(matrix, float)
        if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
            raise ValueError(f"matrix: got shape {matrix.shape}, expected (4, 4) finite numbers")
        self.scene, self.size = scene, np.array(size, float)
        # Columns: a, b, h and 1. Clip coordinates x, y become texture coordinates t, s.
        turned = matrix @ np.block([[scene.axes.T, scene.origin[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]])
        rows = np.stack([(turned[0] + turned[3]) / 2, (turned[1] + turned[3]) / 2, turned[3]])
        drift = np.abs(rows[:, 2]).max() * scene.size
        # Rounding of the matrix's product: a few units in the last place of its largest entry.
        if drift > 1e-6 * np.abs(rows[:, [0, 1, 3]] * [scene.size, scene.size, 1]).max():
            raise ValueError("matrix: got one for another light, expected light rays of constant (t, s)")
        self.plane = rows[:, [0, 1, 3]]  # (a, b, 1) to (t w, s w, w)
        self.back = np.linalg.inv(self.plane)
        self.depth_row, self.w_row = turned[2], turned[3]

    def texture(self, places: Float[np.ndarray, "P 2"]) -> Float[np.ndarray, "P 2"]:
        """(t, s) of places (a, b), in [0, 1] inside the map.

        Args:
            places: (P, 2).
        """
        return _projected(self.plane, places)[0]

    def place(self, texture: Float[np.ndarray, "P 2"]) -> Float[np.ndarray, "P 2"]:
        """Places (a, b) of (t, s).

        Args:
            texture: (P, 2), (t, s).
        """
        return _projected(self.back, texture)[0]

    def stretch(self, texture: Float[np.ndarray, "P 2"]) -> Float[np.ndarray, "P 2 2"]:
        """d(a, b)/d(t, s), the last index for t and s: the texel's edges on the light plane, times the map's size.

        Args:
            texture: (P, 2), (t, s).
        """
        places, w = _projected(self.back, texture)
        made = np.empty((len(texture), 2, 2))
        for i, j in np.ndindex(2, 2):
            made[:, i, j] = (self.back[i, j] - places[:, i] * self.back[2, j]) / w
        return made

    def stored(self, places: Float[np.ndarray, "P 2"], heights: Float[np.ndarray, " P"]) -> Float[np.ndarray, " P"]:
        """The map's depth z/w of points, in [-1, 1] for receivers.

        Args:
            places, heights: (a, b) and h of P points.
        """
        a, b = places[:, 0], places[:, 1]
        z = a * self.depth_row[0] + b * self.depth_row[1] + heights * self.depth_row[2] + self.depth_row[3]
        return z / (a * self.w_row[0] + b * self.w_row[1] + self.w_row[3])

    @property
    def unit_depth(self) -> float:
        """The distance along the light that the map's depth range spans where w is 1 (no warp: everywhere)."""
        return 2 / self.depth_row[2]

    def visibility(
        self, frame: Frame, reading: Reading, shift: Float[np.ndarray, "P 2"] | None = None
    ) -> Float[np.ndarray, " P"]:
        """The lit share that each judged pixel reads from the map, 0 or 1 for "nearest".

        Args:
            frame: of the same scene.
            reading: filter and bias.
            shift: by how many texels the grid lies off its place for each pixel: with random ones the error is the
                mean over where the grid happens to lie.

        Returns:
            (P,) in [0, 1].
        """
        shift = np.zeros((len(frame.places), 2)) if shift is None else shift
        texture = self.texture(frame.places)
        if reading.blurs:
            return blurred(frame, self.visibility(frame, reading.sharp, shift), reading)
        taps = _TAPS[reading.filter]
        position = texture * self.size + shift
        # The first texel read; with 2x2 taps the four whose centres surround the receiver.
        first = np.floor(position - (taps - 1) / 2)
        share = position - 0.5 - first
        total = np.zeros(len(texture))
        for i in range(taps):
            for j in range(taps):
                read = self._verdicts(frame, texture, first + np.array([i, j]), shift, reading)
                weight = 1 / taps**2
                if taps == 2:
                    weight = np.abs(1 - i - share[:, 0]) * np.abs(1 - j - share[:, 1])
                total += weight * read
        return total

    def _verdicts(
        self, frame: Frame, texture: np.ndarray, texel: np.ndarray, shift: np.ndarray, reading: Reading
    ) -> Bool[np.ndarray, " P"]:  # fmt: skip
        """Whether each receiver is lit by the texel with these whole coordinates in its shifted grid."""
        centre = (texel + 0.5 - shift) / self.size
        # Neighbours with the same texel and shift share a ray: a map holds one depth a texel.
        places, first = self.place(centre), None
        new = np.ones(len(texel), bool)
        new[1:] = ((texel[1:] != texel[:-1]) | (shift[1:] != shift[:-1])).any(1)
        which = np.cumsum(new) - 1
        traced = places[new]
        if reading.bias == "back_faces":
            first = self.scene.back_hits(traced)[0]
        else:
            first = self.scene.first_hits(traced)[0]
            if reading.bias == "second_depth":
                second = self.scene.second_hits(traced)
                first = (first + second) / 2  # infinite below a single sheet, which then casts no shadow
        first = first[which]
        heights, at = frame.heights, frame.places
        if reading.bias == "plane":
            heights = heights + (frame.slopes * (places - at)).sum(1)
            at = places
        edges = self.stretch(texture) / self.size
        rise = frame.slopes[:, :1] * edges[:, 0] + frame.slopes[:, 1:] * edges[:, 1]
        if reading.warped_depth:
            hit = np.isfinite(first)
            caster = np.where(hit, self.stored(places, np.where(hit, first, 0)), np.inf)
            receiver = self.stored(at, heights)
            # d(z/w) = (dz - (z/w) dw)/w along the receiver's plane, for one texel of each axis
            w = at[:, 0] * self.w_row[0] + at[:, 1] * self.w_row[1] + self.w_row[3]
            dz = np.einsum("k,ikj->ij", self.depth_row[:2], edges) + self.depth_row[2] * rise
            dw = np.einsum("k,ikj->ij", self.w_row[:2], edges)
            slope = np.abs((dz - receiver[:, None] * dw) / w[:, None]).max(1)
            bias = 2 * reading.texels if reading.bias == "constant" else reading.texels * slope
            return ~(caster < receiver - bias)
        bias = reading.texels * (self.unit_depth if reading.bias == "constant" else np.maximum(*np.abs(rise).T))
        return ~(first < heights - bias - self.scene.tolerance(np.abs(frame.slopes).sum(1)))


def _projected(matrix: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(points under a 3 x 3 homography, their w). Row by row: products of such thin matrices are slow in BLAS."""
    x, y = points[:, 0], points[:, 1]
    u, v, w = (row[0] * x + row[1] * y + row[2] for row in matrix)
    made = np.empty((len(points), 2))
    np.divide(u, w, out=made[:, 0])
    np.divide(v, w, out=made[:, 1])
    return made, w


def screen_steps(shadow_map: ShadowMap, frame: Frame, texture: Float[np.ndarray, "P 2"]) -> Float[np.ndarray, "P 2 2"]:
    """d(t, s)/d(column, row): how far a step of one pixel goes in the map on each receiver's plane.

    The last index is the screen's: to the right and down. Its inverse over the map's size is a texel's footprint in
    pixels, perspective and projection error together.
    """
    scene, camera = shadow_map.scene, frame.camera
    height, width = frame.judged.shape
    left, right, bottom, top = camera.window
    at, z = np.column_stack([frame.places, frame.heights]), frame.depth[frame.judged]
    turn = camera.rotation @ scene.axes.T  # rows: right, up and forward in (a, b, h)
    steps = np.stack([turn[0] * (right - left) / width, -turn[1] * (top - bottom) / height])
    # On the plane h = slopes . (a, b) + const, c = z r: dc = z dr + r dz with n . dc = 0; c = o + z r, dc = do + r dz
    # of parallel rays.
    rays = (at - scene.coordinates(camera.position)) / z[:, None]
    if camera.is_orthographic:
        rays, z = np.broadcast_to(turn[2], at.shape), np.ones_like(z)
    normal = np.column_stack([-frame.slopes, np.ones(len(at))])
    across = np.einsum("ij,ij->i", normal, rays)
    moved = z[:, None, None] * (steps - rays[:, None] * ((normal @ steps.T) / across[:, None])[..., None])
    return np.linalg.solve(shadow_map.stretch(texture), moved[..., :2].transpose(0, 2, 1))


def blurred(frame: Frame, sharp: Float[np.ndarray, " P"], reading: Reading) -> Float[np.ndarray, " P"]:
    """SC 4.3: the grey image of 2x2 reads, blurred on the screen; with depth, near the viewer most."""
    whole = frame.judged.astype(float)
    image = frame.image(sharp, 0.0)
    z = frame.depth[frame.judged]
    widest = reading.blur_pixels / 2
    sigma = np.full(len(z), widest)
    if reading.filter == "eye_blur_depth":
        sigma = widest * np.minimum(1, np.quantile(z, _NEAREST) / z)
    # A few blurs, and between them the mean in proportion: each pixel has a width of its own.
    levels = widest * np.array([0.0, 0.25, 0.5, 1.0])
    stack = [sharp]
    for level in levels[1:]:
        smooth = ndimage.gaussian_filter(image, level), ndimage.gaussian_filter(whole, level)
        stack.append((smooth[0] / np.where(frame.judged, smooth[1], 1))[frame.judged])
    upper = np.clip(np.searchsorted(levels, sigma), 1, len(levels) - 1)
    share = (sigma - levels[upper - 1]) / (levels[upper] - levels[upper - 1])
    every, pixel = np.stack(stack), np.arange(len(z))
    return np.clip((1 - share) * every[upper - 1, pixel] + share * every[upper, pixel], 0, 1)
