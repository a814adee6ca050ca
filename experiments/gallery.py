"""The pictures of docs/gallery.md out of finished runs: the same pixels in fewer bytes.

After `warpopt run configs/paper.toml`, `warpopt scene configs/landscape.toml`, and `warpopt compare` of
configs/compare.toml and configs/compare_landscape.toml.
"""

import argparse
from pathlib import Path

from PIL import Image

LOSSLESS, PALETTE = False, True  # drawings have few colours, and 256 of them are enough
PICTURES = {
    "ratio.png": ("paper/ratio.png", LOSSLESS),
    "lambda.png": ("paper/lambda.png", PALETTE),
    "error_distribution.png": ("paper/error_distribution.png", PALETTE),
    "focus_region.png": ("paper/focus_region.png", LOSSLESS),
    "compare.png": ("compare/map.png", PALETTE),
    "compare_landscape.png": ("compare_landscape/map.png", PALETTE),
    "landscape.png": ("landscape/error_map_camera0_light11_p_inf.png", LOSSLESS),
    "light_path.png": ("landscape/light_path.png", LOSSLESS),
}


def main(words: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--runs", type=Path, default=Path("runs"), help="the folder of the runs' folders")
    parser.add_argument("--directory", type=Path, default=Path("docs/images"))
    arguments = parser.parse_args(words)
    missing = [source for source, _ in PICTURES.values() if not (arguments.runs / source).exists()]
    if missing:
        parser.error(f"not in {arguments.runs}: {', '.join(missing)}")
    for name, (source, few_colours) in PICTURES.items():
        image = Image.open(arguments.runs / source).convert("RGB")
        if few_colours:
            image = image.quantize(256, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE)
        image.save(arguments.directory / name, optimize=True)
        print(f"{name}: {(arguments.directory / name).stat().st_size:,} bytes")


if __name__ == "__main__":
    main()
