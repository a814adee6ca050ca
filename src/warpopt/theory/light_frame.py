"""The axes of the warping frustum W for any camera and any directional light."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from .._checks import Numbers, assembled, checked, float_arrays, instance, is_traced
from .camera import Camera, DirectionalLight


class LightFrame(eqx.Module):
    """W's axes in eye coordinates (SC (3)): Z_w = normalised v - l (l.v), X_w perpendicular to it and to the light.

    Where light and view are parallel (sin(theta) < eps^(1/2)), Z_w is fixed to the screen's down axis, with zero
    gradient: the limit of AT09's setting as theta goes to 0.

    Attributes:
        x_axis, z_axis, light: (3,) unit vectors in eye coordinates.
        theta: angle between light and view, radians in [0, pi].
        parallel: whether Z_w is fixed to the screen's down axis.
        density_p, density_q: screen units per unit slope (x/z, y/z; per length if orthographic), across X_w's screen
            image and along it: E_p E_q is the texel's area for pixels of any shape.
        pixel_ratio: a length along X_w's image over the same across it, in pixels; 1 for square pixels.
        pixels: (2, 2), the screen images of X_w and Z_w as columns, in screen units per unit slope.
        texels: of the map along (t, s); (1, 1) without resolutions.
        is_orthographic: whether the view's rays are parallel.

    Example:
        >>> import warpopt
        >>> camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=100.0, half_fov=0.5)
        >>> frame = LightFrame(camera, warpopt.DirectionalLight((0, -1, 0)))
        >>> [abs(float(v)) for v in frame.z_axis]   # a light from above: the map is warped along the view
        [0.0, 0.0, 1.0]
    """

    x_axis: Float[Array, "3"]
    z_axis: Float[Array, "3"]
    light: Float[Array, "3"]
    theta: Float[Array, ""]
    parallel: Bool[Array, ""]
    density_p: Float[Array, ""]
    density_q: Float[Array, ""]
    pixel_ratio: Float[Array, ""]
    pixels: Float[Array, "2 2"]
    texels: Float[Array, "2"]
    is_orthographic: bool = eqx.field(static=True, default=False)

    def __init__(
        self,
        camera: Camera,
        light: DirectionalLight,
        screen: Numbers | None = None,
        shadow_map: Numbers | None = None,
    ):
        """The axes for one camera and one light.

        Args:
            camera, light: one of each; use `jax.vmap` for more.
            screen: (width, height) in pixels.
            shadow_map: texels along (t, s), across and along the warp. With both, as arrays or pairs, errors are in
                pixels per texel. Without them the screen has square pixels and height 2, and the map is 1 by 1, the
                units of AT09 (13), (14). Traced values must come from a `SceneView`, which has checked them.

        Raises:
            ValueError: only one of `screen` and `shadow_map`, or not two positive numbers.
        """
        instance("camera", camera, Camera)
        instance("light", light, DirectionalLight)
        if not is_traced(screen, shadow_map):
            screen, shadow_map = resolutions(screen, shadow_map)
        width, height, t, s = _screen_scale(camera, screen, shadow_map)
        l = camera.rotation @ light.direction.astype(camera.rotation.dtype)  # noqa: E741, the paper's letter
        # v = (0, 0, 1): v - l (l.v) = (-lx lz, -ly lz, lx^2 + ly^2), whose length is sin(theta).
        sine_squared = l[0] ** 2 + l[1] ** 2
        # Z_w is arbitrary where light and view are parallel, and its gradient grows as 1/sin(theta). Up to sqrt(eps),
        # fixing it changes the depths by less than rounding changes the warp.
        parallel = sine_squared < jnp.finfo(l.dtype).eps
        sine = jnp.sqrt(jnp.where(parallel, 1, sine_squared))
        # X_w lies in the screen plane; to the right where the light travels up the screen, as in AT09's figures. The
        # sign is chosen so that x does not flip when the light passes the view direction.
        across_screen = jnp.stack([l[1], -l[0], jnp.zeros_like(l[0])]) / sine
        # Fixed axes too are exactly perpendicular to the light: a caster and its receiver share a texel.
        fixed = jax.lax.stop_gradient(l)
        tilt = -fixed[0] / jnp.where(parallel, fixed[2], 1)
        size = jnp.sqrt(1 + tilt * tilt)
        right, deep = 1 / size, tilt / size
        fixed_x = jnp.stack([right, jnp.zeros_like(right), deep])
        # The cross product of the two; by `jnp.cross` it is four kernels on a GPU, and not a part of one.
        fixed_z = jnp.stack([-deep * fixed[1], deep * fixed[0] - right * fixed[2], right * fixed[1]])
        x_axis = jnp.where(parallel, fixed_x, across_screen)
        z_axis = jnp.stack([-l[0] * l[2], -l[1] * l[2], sine_squared]) / sine
        z_axis = jnp.where(parallel, fixed_z, z_axis)
        self.x_axis, self.z_axis, self.light = x_axis, z_axis, l
        self.theta = jnp.where(parallel, jnp.where(l[2] < 0, jnp.pi, 0.0), jnp.arctan2(sine, l[2]))
        self.parallel, self.is_orthographic = parallel, camera.is_orthographic
        # Lengths on the light plane are taken for lengths on the screen, turned so that X_w is along its own image.
        dx, dy = x_axis[0], x_axis[1]
        self.pixels = jnp.stack([jnp.stack([dx * width, dy * height]), jnp.stack([dy * width, -dx * height])], -1)
        self.texels = jnp.stack([jnp.asarray(v, l.dtype) for v in (t, s)])
        self.density_p, self.density_q, self.pixel_ratio = _densities(self.pixels, self.texels)

    def turned(self, cosine: Float[Array, ""], sine: Float[Array, ""]) -> "LightFrame":
        """The frame whose Z_w is this one's, turned about the light towards X_w by an angle with that cosine and sine.

        Args:
            cosine, sine: of the angle.

        Example:
            >>> import jax.numpy as jnp, warpopt
            >>> camera = warpopt.Camera((0, 2, 0), (0, 0, -1), (0, 1, 0), near=0.1, far=100.0, half_fov=0.5)
            >>> frame = LightFrame(camera, warpopt.DirectionalLight((0, -1, 0))).turned(jnp.zeros(()), jnp.ones(()))
            >>> [abs(float(v)) for v in frame.z_axis]   # warped across the view instead of along it
            [1.0, 0.0, 0.0]
        """
        x_axis = cosine * self.x_axis - sine * self.z_axis
        z_axis = cosine * self.z_axis + sine * self.x_axis
        across, along = self.pixels.T
        pixels = jnp.stack([cosine * across - sine * along, cosine * along + sine * across], -1)
        return assembled(
            LightFrame, x_axis=x_axis, z_axis=z_axis, light=self.light, theta=self.theta, parallel=self.parallel,
            pixels=pixels, texels=self.texels, is_orthographic=self.is_orthographic,
            **dict(zip(("density_p", "density_q", "pixel_ratio"), _densities(pixels, self.texels), strict=True)),
        )  # fmt: skip

    def towards(self, vector: Float[Array, "3"]) -> "LightFrame":
        """The frame whose Z_w is a vector in eye coordinates projected along the light; this one where none is left.

        Args:
            vector: of any length.
        """
        ahead, aside = self.z_axis @ vector, self.x_axis @ vector
        square = ahead * ahead + aside * aside
        # What rounding leaves of a vector along the light has no direction.
        usable = square > jnp.finfo(square.dtype).eps * (vector * vector).sum()
        length = jnp.sqrt(jnp.where(usable, square, 1))
        return self.turned(jnp.where(usable, ahead / length, 1), jnp.where(usable, aside / length, 0))

    def shared(self, shares: Float[Array, "2"]) -> "LightFrame":
        """The frame of a map whose texels along (t, s) are multiplied by these factors.

        Args:
            shares: factors > 0.
        """
        p, q, ratio = _densities(self.pixels, self.texels * shares)
        return eqx.tree_at(
            lambda f: (f.density_p, f.density_q, f.pixel_ratio, f.texels), self, (p, q, ratio, self.texels * shares)
        )

    @property
    def screen_axes(self) -> Float[Array, "2 2"]:
        """Vectors (right, up) in pixels: Z_w's screen image, on lit surfaces, over its part across X_w's image; and the
        unit vector along X_w's image."""
        across, along = self.pixels.T
        length = jnp.sqrt((across * across).sum())
        height = (across[1] * along[0] - across[0] * along[1]) / length
        return jnp.stack([along / height, across / length])

    def depth(self, points: Float[Array | np.ndarray, "... 3"]) -> Float[Array, "..."]:
        """Z_w . c for points in eye coordinates.

        Args:
            points: (..., 3).

        Returns:
            (...) lengths.
        """
        return jnp.asarray(points) @ self.z_axis

    def across_edges(
        self, right: Float[Array, "..."], up: Float[Array, "..."]
    ) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        """Components of edges' unit normals (right, up) in pixels along `screen_axes`: of Z_w's image and of X_w's.

        Args:
            right, up: of shapes that broadcast.
        """
        along, across = (right * axis[0] + up * axis[1] for axis in self.screen_axes)
        return along, across

    def lateral(self, points: Float[Array | np.ndarray, "... 3"]) -> Float[Array, "..."]:
        """X_w . c.

        Args:
            points: (..., 3) in eye coordinates.

        Returns:
            (...) lengths.
        """
        return jnp.asarray(points) @ self.x_axis

    def eye_depth(self, points: Float[Array | np.ndarray, "... 3"]) -> Float[Array, "..."]:
        """The depth that errors are inversely proportional to: z, or 1 where the view's rays are parallel.

        Args:
            points: (..., 3) in eye coordinates.

        Returns:
            (...) lengths.
        """
        z = jnp.asarray(points)[..., 2]
        return jnp.ones_like(z) if self.is_orthographic else z

    def along_light(self, points: Float[Array | np.ndarray, "... 3"]) -> Float[Array, "..."]:
        """l . c, which increases away from the light.

        Args:
            points: (..., 3) in eye coordinates.

        Returns:
            (...) lengths.
        """
        return jnp.asarray(points) @ self.light


def resolutions(
    screen: Numbers | None, shadow_map: Numbers | None
) -> tuple[Float[Array, "2"] | None, Float[Array, "2"] | None]:
    """Both as arrays, or neither.

    Raises:
        ValueError: only one of the two, or not two positive finite numbers.
    """
    pair = []
    for name, value in (("screen", screen), ("shadow_map", shadow_map)):
        if value is None:
            pair.append(None)
            continue
        (value,) = float_arrays(**{name: value})
        if value.shape != (2,):
            raise ValueError(f"{name}: got shape {value.shape}, expected two numbers")
        pair.append(checked(name, value, lambda v: (v > 0) & (v < jnp.inf), "two positive numbers"))
    if (pair[0] is None) != (pair[1] is None):
        name, other = ("shadow_map", "screen") if pair[0] is None else ("screen", "shadow_map")
        raise ValueError(f"{other}: got none with {name}, expected both or neither")
    return pair[0], pair[1]


def _densities(pixels: Array, texels: Array) -> tuple[Array, Array, Array]:
    """(density_p, density_q, pixel_ratio)."""
    (ax, bx), (ay, by) = pixels
    along = jnp.sqrt(ax * ax + ay * ay)
    across = (ay * bx - ax * by) / along  # area over length
    t, s = texels
    return across / s, along / t, along / across


def _screen_scale(
    camera: Camera, screen: Numbers | None, shadow_map: Numbers | None
) -> tuple[ArrayLike, ArrayLike, ArrayLike, ArrayLike]:
    """(screen units per unit slope across, and up, texels along t, along s)."""
    left, right, bottom, top = camera.window
    if screen is None or shadow_map is None:
        density = 2 / (top - bottom)
        return density, density, 1, 1
    dtype = left.dtype
    (columns, rows), (t, s) = jnp.asarray(screen, dtype), jnp.asarray(shadow_map, dtype)
    return columns / (right - left), rows / (top - bottom), t, s
