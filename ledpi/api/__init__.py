"""What `import ledpi` offers to Python programs: a reader of pictures, its lens, and the markers that it finds."""

from ledpi.api.lens import Lens
from ledpi.api.marker import Marker
from ledpi.api.reader import Reader
from ledpi.api.stream import Stream

__all__ = ["Lens", "Marker", "Reader", "Stream"]
