"""A warning is said once, however often its cause comes and goes."""

from fisheye_ep_calib.live.announcer import Announcer


def test_what_comes_and_goes_stands_until_it_is_calm() -> None:
    said: list[str] = []
    now = 0.0
    announcer = Announcer(said.append, said.append, lambda: now)
    while now < 100:  # an image that can be used after each that cannot
        now += 1.0
        announcer.warn_once("image", "bad")
        announcer.over("image", "good again", calm=5.0)
    assert said == ["bad"]
    now = 105.0
    announcer.over("image", "good again", calm=5.0)
    announcer.warn_once("image", "bad")
    announcer.over("image", "good again")
    assert said == ["bad", "good again", "bad", "good again"]
