"""The sphere: directions, frames, pixels and maps."""
