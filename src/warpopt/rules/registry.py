"""All rules for lambda: name, title, source, colour, and the location of the function.

Does not import JAX until a rule is called, so that a configuration's names can be checked without waiting for JAX.
"""

import dataclasses
import importlib
from collections.abc import Callable
from typing import Any, Literal


@dataclasses.dataclass(frozen=True)
class Rule:
    """A rule for lambda; called like its function, (frustum, theta, **parameters) -> Warp.

    Attributes:
        name: of the function; used in tables and configurations.
        title: for reports and figures.
        source: where it was published, or the engine's file and commit.
        group: the module of `warpopt.rules` that contains the function.
        colour: of its curve, from Okabe and Ito's palette, which is distinct under common colour blindness; black is
            the optimum's.
        takes_body: whether a `Body` can replace the frustum; False if the rule's focus region is a part of V.
        follows: a rule that it nearly equals; drawn next to it, with dashes.

    Example:
        >>> import warpopt
        >>> rule = warpopt.rules.PUBLISHED["lispsm"]
        >>> rule.title, round(float(rule(warpopt.ViewFrustum(1.0, 100.0, 0.5236), 1.5707963).lam), 3)
        ('LiSPSM', 11.0)
    """

    name: str
    title: str
    source: str
    group: Literal["published", "engines"]
    colour: str = "#7b5ea7"
    takes_body: bool = True
    follows: str | None = None

    @property
    def function(self) -> Callable[..., Any]:
        """The rule's function; loads JAX."""
        return getattr(importlib.import_module(f".{self.group}", __package__), self.name)

    def __call__(self, frustum: Any, theta: Any, **parameters: Any) -> Any:
        return self.function(frustum, theta, **parameters)


def _named(*rules: Rule) -> dict[str, Rule]:
    return {rule.name: rule for rule in rules}


PUBLISHED = _named(
    Rule("ssm", "no warp", "Standard shadow maps", "published", "#a3a3a3"),
    Rule("psm", "PSM", "AT09 section 2.1", "published", "#cc79a7"),
    Rule("lispsm", "LiSPSM", "VN section 2.1", "published", "#0072b2"),
    Rule("tsm", "TSM", "VN (16), corrected", "published", "#d55e00"),
    Rule("tsm_alternative", "TSM alternative", "VN section 3", "published", "#e69f00", takes_body=False),
    Rule("minimum_norm", "minimum norm on axis", "Generalised minimum norm on the view axis", "published", "#009e73"),
    Rule("scherzer", "Scherzer's LiSPSM", "SC (1), (2)", "published", "#56b4e9", follows="lispsm"),
)
ENGINES = _named(
    Rule("lispsm_paper", "LiSPSM (2004 paper)", "Wimmer, Scherzer and Purgathofer 2004", "engines"),
    Rule("filament", "Filament", "filament/src/ShadowMap.cpp @0362f36", "engines"),
    Rule(
        "osg_lispsm", "OSG LiSPSM", "src/osgShadow/LightSpacePerspectiveShadowMap.cpp @2e4ae2e", "engines"
    ),
    Rule("osg_lispsm_corrected", "OSG LiSPSM, corrected", "`osg_lispsm` with consistent units", "engines"),
    Rule("osg_vdsm", "OSG VDSM", "src/osgShadow/ViewDependentShadowMap.cpp:1959 @2e4ae2e", "engines"),
    Rule("openmw", "OpenMW", "components/sceneutil/mwshadowtechnique.cpp:2953 @e47ad77", "engines"),
    Rule("ogre", "OGRE", "OgreMain/src/OgreShadowCameraSetupLiSPSM.cpp @00dd9a5", "engines"),
    Rule("veloren", "Veloren", "voxygen/src/scene/mod.rs @d36ddcb", "engines"),
    Rule("tsm_xray", "X-Ray TSM", "src/Layers/xrRender_R2/r2_R_sun.cpp @ec397af", "engines"),
    Rule("tsm_dagor", "Dagor TSM", "prog/gameLibs/render/psm.cpp @3aaa489", "engines"),
)  # fmt: skip
EVERY = PUBLISHED | ENGINES


def rule_title(name: str) -> str:
    """A rule's title; a user rule's title is its name."""
    return EVERY[name].title if name in EVERY else name
