"""Limits of BLAS and torch to one thread."""

from threading import Barrier, Thread

import torch
from threadpoolctl import ThreadpoolController

from bilevel.threads import one_blas_thread, one_torch_thread


def of_blas() -> set[int]:
    libraries = ThreadpoolController().select(user_api="blas").info()
    return {library["num_threads"] for library in libraries}


def test_the_last_of_overlapping_limits_is_removed() -> None:
    """Evaluations on threads start and end in any order."""
    inside, first_left = Barrier(2), Barrier(2)
    seen: list[set[int]] = []

    def first() -> None:
        with one_blas_thread():
            inside.wait()
        first_left.wait()

    def second() -> None:
        with one_blas_thread():
            inside.wait()
            first_left.wait()
            seen.append(of_blas())

    with ThreadpoolController().limit(limits=2, user_api="blas"):  # also on one core
        threads = [Thread(target=first), Thread(target=second)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join(60)
        assert seen == [{1}]
        assert of_blas() == {2}


def test_torch_gets_its_threads_back() -> None:
    torch.set_num_threads(2)
    try:
        with one_torch_thread():
            assert torch.get_num_threads() == 1
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(1)
