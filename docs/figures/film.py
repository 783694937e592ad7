"""The README's moving picture: a finger lets go of the cube and comes back; the others take over.

Run by ``make picture``; writes docs/images/regrasp.webp.
"""

from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image

import graspforce as gf
from graspforce._util import plot
from graspforce.study.figures import grasp_picture

FRAMES, RATE = 50, 20  # of two seconds, shown a little slower
scenario = gf.scenarios.get("regrasp", shape="smooth")
times = np.linspace(0, scenario.times[-1], FRAMES)
figures = [grasp_picture.draw(grasp_picture.data(scenario, t)) for t in times]

# One frame around everything, so that the palm stays where it is.
limits = np.array(
    [[f.axes[0].get_xlim(), f.axes[0].get_ylim(), f.axes[0].get_zlim()] for f in figures]
)
low, high = limits[..., 0].min(axis=0), limits[..., 1].max(axis=0)
pictures = []
for figure in figures:
    axes = figure.axes[0]
    axes.set(**{f"{axis}lim": ends for axis, *ends in zip("xyz", low, high, strict=True)})
    axes.set_box_aspect(high - low, zoom=1.35)
    with Image.open(BytesIO(plot.render(figure, "png"))) as picture:
        pictures.append(picture.convert("RGB").resize((640, 480), Image.Resampling.LANCZOS))
pictures[0].save(
    Path(__file__).parents[1] / "images" / "regrasp.webp",
    save_all=True, append_images=pictures[1:], duration=1000 // RATE, loop=0, quality=70, method=6,
)  # fmt: skip
