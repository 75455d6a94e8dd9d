"""Interactive figures that move with a kernel (JupyterLab) and without one (the static book).

`Replay` plays a run of a robot and layers such as `Paths`, `Sweep` moves sliders over precomputed
results, `Simulator` is P5's program: a robot with a lidar to drive. In `Sighting`, `ScanDrag` and
`WallDrag` the reader drags things and an algorithm answers. All draw on a canvas in plain
JavaScript, through anywidget. Import it where it is used.
"""

from slamlab.widgets.drag import ScanDrag, Sighting, WallDrag
from slamlab.widgets.layers import (
    Landmarks,
    LidarPoints,
    Occupancy,
    Particles,
    Paths,
    WallSegments,
)
from slamlab.widgets.replay import Replay
from slamlab.widgets.simulator import Simulator
from slamlab.widgets.sweep import Bars, Curves, Image, Scatter, Sweep

__all__ = [
    "Bars",
    "Curves",
    "Image",
    "Landmarks",
    "LidarPoints",
    "Occupancy",
    "Particles",
    "Paths",
    "Replay",
    "ScanDrag",
    "Scatter",
    "Sighting",
    "Simulator",
    "Sweep",
    "WallDrag",
    "WallSegments",
]
