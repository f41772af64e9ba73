"""The commands `vsh-sim` and `vsh-agis`."""
