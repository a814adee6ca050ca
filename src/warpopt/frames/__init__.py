"""Shadow maps on pixels: rays from the light as truth, maps read texel by texel through their matrix, and the error.

Needs the package embreex (the extra `frames`). Does not need JAX, except `fits`.
"""

from .light_rays import LitScene, NoRayCaster, ray_caster
from .measure import Verdict, judge, measured, predicted_wrong, texel_footprints
from .seen import Frame, see
from .shadow_map import BIASES, FILTERS, Reading, ShadowMap

__all__ = [
    "BIASES",
    "FILTERS",
    "Frame",
    "LitScene",
    "NoRayCaster",
    "Reading",
    "ShadowMap",
    "Verdict",
    "judge",
    "measured",
    "predicted_wrong",
    "ray_caster",
    "see",
    "texel_footprints",
]
