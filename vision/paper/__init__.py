"""The system of the paper, Sections 3 to 7 to the letter, as the presets `paper` and `previous`.

In: views, a taught model with its strategy. Out: poses by triangulation and the quaternion method. It shares edges,
fragments and regions with the system of this project and nothing that came after them. Where the printed text cannot
work, the departure is named in docs/paper.md with the figure that forced it.
"""
