"""Code shared by two or more commands, and the part of the app that `experiments/` may use.

`experiments/` draws with the commands' style: for it `figure_style`, `error_maps`, `flicker_figure`, `light_plane` and
`jax_settings` are public, as is the package `inputs`; `cli.main` runs a command. The rest of the app is private.
"""
