"""Names that options choose from, as the packages have them (which load too much for --help); a test compares."""

#: `vsh.sky.frames.FRAMES`
FRAMES = ("icrs", "galactic", "ecliptic")
#: `vsh.sky.redshift_frames.REDSHIFT_FRAME_NAMES`
REDSHIFT_FRAMES = ("heliocentric", "cmb", "local-group", "true")
#: The sets of names that `vsh.catalogue.as_columns` knows
COLUMNS = ("gaia", "vizier", "icrf")
#: `vsh.tables.INPUT_FORMATS`, and the IERS's lists
INPUT_FORMATS = ("fits", "votable", "ecsv", "csv", "parquet", "hdf5", "mrt", "cds", "ascii", "icrf")
#: `vsh.cosmology.VELOCITIES`
VELOCITIES = ("planck", "paper")
#: `sim.observing.REDSHIFT_ERRORS`
REDSHIFT_ERRORS = ("spectroscopic", "photometric")
#: `fit.pairs.TEMPLATES`
TEMPLATES = ("spin", "glide", "waves")
#: `fit.correlation.FRAME`: the six components of spin and acceleration.
FRAME = "spin+acceleration"
#: `vsh.archive.QUERIES`
QUERIES = ("gaia-crf3", "gaia-edr3-qso", "gaia-dr3-galaxies")
#: `vsh.archive.ESA`
ESA = "https://gea.esac.esa.int/tap-server/tap"
