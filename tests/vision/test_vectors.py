import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vision.geometry.circle import cross


@given(
    st.integers(0, 2**32 - 1), st.sampled_from([((3,), (3,)), ((5, 3), (5, 3)), ((3,), (4, 3)), ((2, 1, 3), (6, 3))])
)
def test_the_product_is_that_of_numpy(seed, shapes):
    rng = np.random.default_rng(seed)
    a, b = (rng.normal(size=shape) for shape in shapes)
    assert np.array_equal(cross(a, b), np.cross(a, b))
