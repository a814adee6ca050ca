"""Rules for lambda that the literature and engines offer, to compare the optimum with."""

from .body import Body
from .engines import (
    filament,
    lispsm_paper,
    ogre,
    openmw,
    osg_lispsm,
    osg_lispsm_corrected,
    osg_vdsm,
    tsm_dagor,
    tsm_xray,
    veloren,
)
from .published import lispsm, minimum_norm, psm, scherzer, ssm, tsm, tsm_alternative

PUBLISHED = {rule.__name__: rule for rule in (ssm, psm, lispsm, tsm, tsm_alternative, minimum_norm, scherzer)}
ENGINES = {
    rule.__name__: rule
    for rule in (
        lispsm_paper, filament, osg_lispsm, osg_lispsm_corrected, osg_vdsm, openmw, ogre, veloren, tsm_xray, tsm_dagor
    )
}  # fmt: skip

__all__ = [
    "ENGINES",
    "PUBLISHED",
    "Body",
    "filament",
    "lispsm",
    "lispsm_paper",
    "minimum_norm",
    "ogre",
    "openmw",
    "osg_lispsm",
    "osg_lispsm_corrected",
    "osg_vdsm",
    "psm",
    "scherzer",
    "ssm",
    "tsm",
    "tsm_alternative",
    "tsm_dagor",
    "tsm_xray",
    "veloren",
]
