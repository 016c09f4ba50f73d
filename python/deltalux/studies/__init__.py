"""Studies of the temporal coherence of light, and of what the methods make of it (Overbeck 2006, chapters 5 to 8); and
of what transport holds: suns and lamps, light between surfaces, the images of basis functions (Sloan 2005).

Each leaves pictures, tables (CSV) and a page that ends with the papers' claims: our figure, whether it holds, and where
it does not, why. `study` runs one by its name; studies of light alone need no scene.
"""

from .catalogue import STUDIES
from .run import check_study, study

__all__ = ["STUDIES", "check_study", "study"]
