"""Which windows a step learns from, where windows that cost much to encode serve in several steps.

With `reuse` = R, every `R * DRAWS` steps make a round. Its first `DRAWS` steps draw windows and encode them; each
later pass goes through the same windows in another order, drawn for every row of the batch by itself, so that a batch
is made of others each time, and a process that holds some rows needs no windows of other rows. (Data echoing, Choi et
al. 2019: a shuffled sample seen again a few times is worth nearly as much as a fresh one.)
"""

from __future__ import annotations

from functools import lru_cache

from stages.training.task import step_seed

DRAWS = 32
_ORDER = 3  # the purpose of the generators


def draws_afresh(step: int, reuse: int) -> bool:
    """Whether a step's windows are its own."""
    return step % (reuse * DRAWS) < DRAWS


def drawing_step(step: int, row: int, reuse: int, seed: int) -> int:
    """The step that drew what `row` of the batch learns from at `step`: itself, or one of its round's first."""
    if draws_afresh(step, reuse):
        return step
    begin = step - step % (reuse * DRAWS)
    again, place = divmod(step - begin, DRAWS)
    return begin + _order(seed, begin + again, row)[place]


@lru_cache(maxsize=4096)
def _order(seed: int, key: int, row: int) -> tuple[int, ...]:
    return tuple(int(each) for each in step_seed(seed, _ORDER, key * 100_003 + row).permutation(DRAWS))
