"""A malicious or broken server takes no more than it was given, and its key is kept nowhere."""

import pytest
from support.abuse import all_held
from support.abuse.servers import disguises, servers
from support.hosted_server import KEY

from karma.infer.hosted.key import Key


def test_servers_without_end_or_manners_are_bounded_and_the_key_is_kept_nowhere(tmp_path):
    all_held(servers, 110, tmp_path)


@pytest.mark.parametrize("how", [name for name in disguises(KEY) if name != "plain"])
def test_key_in_disguise_is_known(how):
    assert Key(KEY).is_disguised_in({"a": [disguises(KEY)[how]]})


def test_key_in_pieces_is_known_and_innocent_text_is_not():
    key = Key(KEY)
    assert key.is_disguised_in(["x", KEY[:5], {"b": KEY[5:]}])
    assert not key.is_disguised_in({"text": "GoToObject(robot, 'Apple')\n" * 50, "n": [1, None]})
    assert not Key("not-needed").is_disguised_in("it is not needed")
