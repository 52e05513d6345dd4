"""Section 3: cameras, rigid motions, ellipses and circles in space.

In: numbers; out: values with frames and units. Of pictures it knows where they were taken from, not what they show.
"""
