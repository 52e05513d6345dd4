"""How well `vision.detect_ellipses` finds ellipses, and how fast."""
