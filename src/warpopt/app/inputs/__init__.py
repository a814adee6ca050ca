"""The scene inputs of commands: settings, files as numbers, and values for the library.

A separate package: every command over a scene uses it, and `common` does not handle scene files.
"""
