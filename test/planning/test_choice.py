"""Which images are looked at, on recordings whose content is known."""

import numpy as np
import pytest

from fisheye_ep_calib.errors import InputError
from fisheye_ep_calib.planning.image_choice import FrameChoice, closer_look, first_look, room_left
from fisheye_ep_calib.planning.view_selection import ViewSignature


def view(x=0.5, y=0.5, size=0.0, tilt=(0, 0, 0, 0)) -> ViewSignature:
    return ViewSignature(np.array([x, y]), size, np.array(tilt, dtype=float))


def look_at_all_chosen(recording, choice) -> list[int]:
    """recording: image → view or None. The images looked at, in the order of time."""
    seen = {}
    chosen = first_look(len(recording), choice)
    while chosen:
        assert not set(chosen) & set(seen), "an image was looked at twice"
        seen.update((index, recording[index]) for index in chosen)
        chosen = closer_look(seen, room_left(len(seen), len(recording), choice))
    return sorted(seen)


def test_few_images_are_all_looked_at():
    assert look_at_all_chosen([None] * 25, FrameChoice()) == list(range(25))
    assert look_at_all_chosen([view()] * 150, FrameChoice()) == list(range(150))


@pytest.mark.parametrize("count", [1, 2, 3, 10])
@pytest.mark.parametrize("max_views", [1, 2, 3])
def test_small_numbers(count, max_views):
    looked = look_at_all_chosen([view()] * count, FrameChoice(max_views))
    assert 0 < len(looked) <= max_views and max(looked) < count


def test_every_nth_is_looked_at_whatever_it_shows():
    assert look_at_all_chosen([view()] * 1000, FrameChoice(max_views=10, every=100)) == list(range(0, 1000, 100))
    assert len(look_at_all_chosen([None] * 1000, FrameChoice(every=1))) == 1000


@pytest.mark.parametrize("wrong", [{"max_views": 0}, {"every": 0}, {"every": -3}])
def test_nonsense_is_refused(wrong):
    with pytest.raises(InputError):
        FrameChoice(**wrong)


def test_a_target_that_rests_costs_no_more_than_the_first_look():
    looked = look_at_all_chosen([view()] * 2000, FrameChoice())
    assert len(looked) == 50
    assert looked[0] == 0 and looked[-1] == 1999
    assert np.diff(looked).max() <= 42


def test_images_are_looked_at_where_the_target_moves():
    recording = [view()] * 2000
    for index in range(900, 1100):  # crosses the field in a tenth of the time
        recording[index] = view(x=0.1 + 0.8 * (index - 900) / 200)
    looked = np.array(look_at_all_chosen(recording, FrameChoice()))
    while_moving = ((looked >= 900) & (looked < 1100)).mean()
    assert while_moving > 0.2  # an even spread would give a tenth
    positions = sorted(recording[index].position[0] for index in looked if 900 <= index < 1100)
    assert np.diff(positions).max() < 0.16


def test_images_are_looked_at_where_the_target_enters_and_leaves():
    recording = [view() if 500 <= index < 1210 else None for index in range(2000)]
    looked = look_at_all_chosen(recording, FrameChoice())
    found = [index for index in looked if recording[index]]
    assert found[0] <= 502 and found[-1] >= 1207


def test_a_target_seen_briefly_is_searched_for():
    recording = [view(x=index % 7 / 7) if 777 <= index < 800 else None for index in range(2000)]
    looked = look_at_all_chosen(recording, FrameChoice())
    assert len(looked) <= 150
    assert sum(recording[index] is not None for index in looked) >= 5


def test_never_more_than_asked_for():
    generator = np.random.default_rng(0)
    recording = [view(*generator.uniform(size=2), generator.uniform(-2, 2)) for _ in range(3000)]
    assert len(look_at_all_chosen(recording, FrameChoice(max_views=60))) == 60
