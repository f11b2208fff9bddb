"""Half widths of a Gaussian's bands, in standard deviations, and its sd by its median."""

from typing import Final

SIGMA_68: Final = 1.0  # of the band that holds 68.27 %
SIGMA_95: Final = 1.959963984540054  # of the band that holds 95 %
SD_PER_MEDIAN: Final = 1.4826  # sd over the median of |x|: a few outliers change it little
