"""How figures show each way of splitting."""

COLOURS = {
    "best": "#000000", "stepped": "#777777", "logarithmic": "#0d61d9", "practical": "#d62612", "uniform": "#a3a3a3",
    "godot": "#478cbf", "unity": "#7a5c3a", "unreal": "#6b3fa0", "bevy": "#e8833a", "three": "#009e73",
    "filament": "#cc79a7",
}  # fmt: skip
# So that of lines that lie on each other all are seen.
DASHES = {
    "best": "-", "stepped": "-", "logarithmic": (0, (5, 3)), "practical": (0, (2, 2)), "uniform": "-",
    "godot": (0, (7, 2)), "unity": "-", "unreal": (0, (1, 1.5)), "bevy": (0, (4, 2, 1, 2)), "three": (0, (3, 3)),
    "filament": (0, (6, 2, 2, 2)),
}  # fmt: skip
MARKERS = {
    "logarithmic": "o", "practical": "s", "uniform": "D", "godot": "^", "unity": "v", "unreal": "P",
    "bevy": "X", "three": "<", "filament": ">",
}  # fmt: skip
