"""Tables as source code for engines."""
