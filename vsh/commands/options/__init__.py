"""The options of every command, which are parsed before anything else is imported."""
