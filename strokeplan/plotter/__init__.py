"""From strokes to the motion of a pen plotter: order, and the time that it takes."""
