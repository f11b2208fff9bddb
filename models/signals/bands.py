"""How wide a band of a Gaussian is."""

from typing import Final

SIGMA_68: Final = 1.0  # half width of the band that holds 68.27 %, in standard deviations
SIGMA_95: Final = 1.959963984540054  # of that which holds 95 %
