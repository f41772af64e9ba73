"""Threads, files, progress bars and the imports of others."""
