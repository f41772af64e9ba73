"""The commands `vsh-referee`, `vsh-forecast` and `vsh-waves`."""
