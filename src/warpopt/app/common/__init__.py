"""Code shared by two or more commands, and the part of the app that `experiments/` may use.

`experiments/objective_pictures.py` draws with the commands' style: for it `figure_style`, `error_maps` and
`jax_settings`, and for `directions.py` `light_plane`, are public, as is the package `inputs`; `cli.main` runs a command. The rest of the app is private.
"""
