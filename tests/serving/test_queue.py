"""The queue before the meshers: so many may wait, first come, first served, and no place is lost."""

from __future__ import annotations

import asyncio

import pytest
from hypothesis import given
from hypothesis import strategies as st

from freemesh_ray.serving.queue import Busy, Queue, ShareTaken


@given(room=st.integers(0, 6), more=st.integers(1, 3))
def test_no_more_may_wait_than_there_is_room_for(room: int, more: int) -> None:
    async def crowd() -> list[int]:
        queue: Queue[int] = Queue(room)
        waiting = [asyncio.create_task(queue.take(str(i))) for i in range(room)]
        await asyncio.sleep(0)
        for _ in range(more):
            refused = asyncio.create_task(queue.take("another"))
            await asyncio.sleep(0)
            assert refused.done(), "waits"
            with pytest.raises(Busy):
                refused.result()
            assert not isinstance(refused.exception(), ShareTaken)
        for place in range(room + 1):
            queue.give(place)
        return [await task for task in waiting] + [await queue.take("another")]

    assert asyncio.run(crowd()) == list(range(room + 1))


@given(left=st.sets(st.integers(0, 5), max_size=5))
def test_who_leaves_gives_up_the_turn_and_a_place_that_was_given(left: set[int]) -> None:
    async def crowd() -> list[int]:
        queue: Queue[int] = Queue(6)
        waiting = [asyncio.create_task(queue.take(str(i))) for i in range(6)]
        await asyncio.sleep(0)
        queue.give(0)  # the first has it, and may leave before it runs
        for i in left:
            waiting[i].cancel()
        await asyncio.sleep(0)
        staying = [task for i, task in enumerate(waiting) if i not in left]
        for place in range(1, 6):
            queue.give(place)
        return [await task for task in staying]

    assert asyncio.run(crowd()) == list(range(6 - len(left)))


@given(room=st.integers(1, 9), left=st.integers(0, 3))
def test_one_client_has_half_of_the_room(room: int, left: int) -> None:
    async def crowd() -> None:
        queue: Queue[int] = Queue(room)
        share = max(room // 2, 1)
        greedy = [asyncio.create_task(queue.take("greedy")) for _ in range(share)]
        await asyncio.sleep(0)
        if share < room:
            refused = asyncio.create_task(queue.take("greedy"))
            await asyncio.sleep(0)
            assert refused.done(), "waits"
            with pytest.raises(ShareTaken):
                refused.result()
        others = [asyncio.create_task(queue.take(str(i))) for i in range(room - share)]
        await asyncio.sleep(0)
        with pytest.raises(Busy):
            await queue.take("another")
        # Who leaves makes room for one of the same client.
        for task in greedy[:left]:
            task.cancel()
        await asyncio.sleep(0)
        again = [asyncio.create_task(queue.take("greedy")) for _ in greedy[:left]]
        await asyncio.sleep(0)
        staying = [*greedy[left:], *others, *again]
        for place in range(len(staying)):
            queue.give(place)
        # First come, first served, whoever they are.
        assert await asyncio.gather(*staying) == list(range(room))

    asyncio.run(crowd())
