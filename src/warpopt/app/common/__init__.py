"""What two or more commands share. `experiments/` may use `figure_style`, `error_maps` and `jax_settings`."""
