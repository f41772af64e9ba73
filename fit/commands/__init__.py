"""The commands `vsh-fit`, `vsh-redshift` and `vsh-correlate`."""
