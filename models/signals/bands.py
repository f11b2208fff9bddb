"""Half widths of a Gaussian's bands, in standard deviations."""

from typing import Final

SIGMA_68: Final = 1.0  # of the band that holds 68.27 %
SIGMA_95: Final = 1.959963984540054  # of the band that holds 95 %
