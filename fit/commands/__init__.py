"""The commands `vsh-fit`, `vsh-redshift`, `vsh-correlate`, `vsh-compare`, `vsh-link` and `vsh-pairs`."""
