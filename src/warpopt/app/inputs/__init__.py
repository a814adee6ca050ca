"""What commands compute over when it is a scene: its settings, its files in numbers, its values for the library.

A room of its own: it is no command's, as every command over a scene begins with it, and too much for `common`, which
knows nothing of scenes' files.
"""
