"""Rules of one's own, for `warpopt compare` with a TOML file beside this one: own = { mine = "my_rules:half_way" }.

A rule is a callable (frustum, theta) -> warpopt.Warp. theta are the angles between view and light, an array of radians;
a rule that an array is too much for (`math.sin`, an `if`) is called with one angle at a time, which is slower.
"""

import math

import jax.numpy as jnp

import warpopt


def half_way(frustum, theta):
    """Half of LiSPSM's strength: the square root of its eta, 1 for no warp."""
    lispsm = warpopt.rules.lispsm(frustum, theta)
    return warpopt.Warp.from_eta(jnp.sqrt(lispsm.eta), lispsm)


def overhead(frustum, theta):
    """LiSPSM's overhead distance for any light but those within 10 degrees of the view: one angle at a time."""
    view = warpopt.FrustumView(frustum, theta)
    if math.sin(theta) < math.sin(math.radians(10)):
        return warpopt.Warp.from_eta(1.0, view)
    return warpopt.Warp.from_lam(frustum.near + math.sqrt(frustum.near * frustum.far), view)
