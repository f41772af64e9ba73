"""
Gravitational waves, in pairs and one by one
============================================

Waves longer than the observations move sources that are close together alike, and those at 90° against each other: the
astrometric Hellings–Downs curve. Sums over all pairs of sources show it without bias, whatever the errors, since no source
is paired with itself. A single wave from one direction has a pattern of its own, which a search compares with every direction.
"""

import matplotlib.pyplot as plt
import numpy as np

import fit
import sim
from vsh import Field
from vsh.figures.plot import figure_of
from vsh.tools.units import hubble_rate

# %%
# 20 000 sources whose errors are quoted 30 per cent too small, in a background of waves of Ω = 0.05, far more than there is.
rng = np.random.default_rng(3)
lon, lat = rng.uniform(0, 2 * np.pi, 20_000), np.arcsin(rng.uniform(-0.6, 1, 20_000))
waves = sim.wave_background(0.05, rng=4)(lon, lat)
noise = 30 * rng.standard_normal((2, 20_000))
field = Field(lon, lat, waves + noise, np.full((2, 20_000), 20.0))

# %%
# The correlation of pairs, and the curve that fits it.
found = fit.pairs.correlation_function(field, np.radians(np.arange(0, 181, 9.0)))
templates = found.fit(["waves"])
omega, error = templates["waves"]


def omega_of(motion, debiased=True):
    """Ω by the power of degree 2, less what the quoted errors give on average."""
    fitted = fit.fit_field(Field(lon, lat, motion, field.sigma), 2)
    power = sum(fitted.power(kind, 2, debiased=debiased) for kind in "TS")
    return 6 / 5 * power / (4 * np.pi * hubble_rate(70) ** 2)


print(f"this sky's waves have {omega_of(waves, debiased=False):.3f} in degree 2")
print(f"pairs: Ω = {omega:.3f} ± {error:.3f}")
print(f"power of degree 2 less the noise that is quoted: {omega_of(field.motion):.3f}")
figure_of(found.plot(templates)).savefig("pairs.png", dpi=300)

# %%
# One wave in place of the background: where it travels to, and how strong waves from elsewhere can be.
direction = np.array([1.0, 2.0, -0.5])
one = Field(lon, lat, sim.plane_wave(direction, 4.0, -2.0)(lon, lat) + noise, np.full((2, 20_000), 30.0))
search = fit.waves.search(fit.fit_field(one, 5), n_skies=200)
away = np.degrees(np.arccos(search.vector @ direction / np.linalg.norm(direction)))
print(f"one wave: {away:.0f}° from where it travels to, p = {search.p_value:.3f}")
print(search.report())
figure_of(search.plot()).savefig("one_wave.png", dpi=300)
plt.show()
