"""What both extractors and matching read from a picture.

In: a grey picture; out: sub-pixel edge maps, chains and edge fields.
"""
