"""Section 3: cameras, rigid motions, ellipses and circles in space.

In: numbers; out: values with frames and units. Knows no image.
"""
