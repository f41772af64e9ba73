"""The commands `vsh-study`, `vsh-referee`, `vsh-forecast` and `vsh-waves`."""
