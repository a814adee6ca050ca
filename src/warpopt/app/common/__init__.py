"""What two or more commands share, and what `experiments/` may use of the app.

`experiments/objective_pictures.py` draws as the commands do: for it `figure_style`, `error_maps` and `jax_settings`
are public, as is the room `inputs`; `cli.main` is the command itself. All else of the app is the commands' own.
"""
