"""One thread for NumPy's linear algebra."""

import numpy as np

from labkit.process.blas import one_blas_thread, thread_switches


def test_products_of_long_arrays_do_not_depend_on_the_number_of_threads():
    a, b = np.random.default_rng(1).normal(size=(2, 200_000, 3))
    products, counts = [], []
    for threads in (1, 2):
        for _, change in thread_switches():
            change(threads)
        with one_blas_thread():
            products.append(a.T @ b)
            counts += [count() for count, _ in thread_switches()]
        assert all(count() == threads for count, _ in thread_switches())
    np.testing.assert_array_equal(*products)
    assert set(counts) <= {1}
