"""What people call the rules: one name each, in reports, tables and figures alike."""

RULE_NAMES = {
    "ssm": "no warp",
    "psm": "PSM",
    "lispsm": "LiSPSM",
    "tsm": "TSM",
    "tsm_alternative": "TSM alternative",
    "minimum_norm": "minimum norm on axis",
    "scherzer": "Scherzer's LiSPSM",
    "lispsm_paper": "LiSPSM (2004 paper)",
    "filament": "Filament",
    "osg_lispsm": "OSG LiSPSM",
    "osg_lispsm_corrected": "OSG LiSPSM, corrected",
    "osg_vdsm": "OSG VDSM",
    "openmw": "OpenMW",
    "ogre": "OGRE",
    "veloren": "Veloren",
    "tsm_xray": "X-Ray TSM",
    "tsm_dagor": "Dagor TSM",
}


def rule_title(name: str) -> str:
    """A rule's name for people; a user's is its own."""
    return RULE_NAMES.get(name, name)
